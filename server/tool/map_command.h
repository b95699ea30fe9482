// `cairn map info|export FILE.db`: what a saved map holds, and the map in formats of other
// programs.
#pragma once

#include "server/tool/command.h"

namespace cairn {

void add_map_command(CLI::App& app, std::function<int()>& run);

}  // namespace cairn
