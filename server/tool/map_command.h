// `cairn map info|export|undo FILE.db`: what a saved map holds, the map in formats of other
// programs, and back to before a loop or a merge.
#pragma once

#include "server/tool/command.h"

namespace cairn {

void add_map_command(CLI::App& app, std::function<int()>& run);

}  // namespace cairn
