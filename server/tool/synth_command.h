// `cairn synth --scene S --out DIR`: renders the synthetic world into a recording with ground
// truth.
#pragma once

#include "server/tool/command.h"

namespace cairn {

void add_synth_command(CLI::App& app, std::function<int()>& run);

}  // namespace cairn
