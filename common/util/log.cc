#include "common/util/log.h"

#include <memory>
#include <string>

#include <spdlog/sinks/stdout_color_sinks.h>

namespace cairn::log {

Status check_level(std::string_view level) {
  for (const std::string_view known : {"debug", "info", "warn", "error", "off"})
    if (level == known) return {};
  return {ErrorCode::kInvalidArgument,
          fmt::format("must be one of debug, info, warn, error, off; has '{}'", level)};
}

void initialise(std::string_view program, std::string_view level) {
  // Colours on a terminal only; plain lines in a pipe.
  auto logger = std::make_shared<spdlog::logger>(
      std::string(program), std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%l%$ %n: %v");
  const auto parsed = spdlog::level::from_str(std::string(level));
  logger->set_level(parsed == spdlog::level::off && level != "off" ? spdlog::level::info : parsed);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

}  // namespace cairn::log
