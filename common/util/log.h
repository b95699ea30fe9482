// Logging: one line an event, on stderr, through spdlog. Include this, not spdlog itself:
//   log::info("keyframe {} mapped in {:.1f} ms", id, ms);
#pragma once

#include <string_view>

#include <spdlog/spdlog.h>

#include "common/util/status.h"

namespace cairn::log {

using spdlog::debug;
using spdlog::error;
using spdlog::info;
using spdlog::warn;

// kInvalidArgument, naming the levels that there are, unless `level` is one of them.
Status check_level(std::string_view level);

// spdlog's default logger is made before main: whoever logs first on two threads at once, as unit
// tests do, would make it there, which ThreadSanitizer takes for a race since it does not see into
// the library.
inline const bool kLoggerIsMade = spdlog::default_logger_raw() != nullptr;

// Call once in main. `level`: debug, info, warn, error or off; anything else counts as info.
void initialise(std::string_view program, std::string_view level);

}  // namespace cairn::log
