// `cairn eval GROUNDTRUTH ESTIMATE`: how far an estimated trajectory is from the true one.
#pragma once

#include "server/tool/command.h"

namespace cairn {

void add_eval_command(CLI::App& app, std::function<int()>& run);

}  // namespace cairn
