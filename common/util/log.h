// Logging: one line an event, on stderr, through spdlog. Include this, not spdlog itself:
//   log::info("keyframe {} mapped in {:.1f} ms", id, ms);
#pragma once

#include <string_view>

#include <spdlog/spdlog.h>

namespace cairn::log {

using spdlog::debug;
using spdlog::error;
using spdlog::info;
using spdlog::warn;

// Call once in main. `level`: debug, info, warn, error or off; anything else counts as info.
void initialise(std::string_view program, std::string_view level);

}  // namespace cairn::log
