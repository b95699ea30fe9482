// `cairn vocab train|info`: the vocabulary of place recognition.
#pragma once

#include "server/tool/command.h"

namespace cairn {

void add_vocab_command(CLI::App& app, std::function<int()>& run);

}  // namespace cairn
