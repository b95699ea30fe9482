#include "common/util/log.h"

#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::MatchesRegex;

// What `write` puts on stderr with the log at `level`.
std::string logged(const char* level, void (*write)()) {
  testing::internal::CaptureStderr();
  log::initialise("cairn-test", level);
  write();
  return testing::internal::GetCapturedStderr();
}

TEST(Log, OneLineAnEventWithTimeLevelAndProgram) {
  const std::string line = logged("info", [] { log::info("mapped {} in {:.1f} ms", 3, 0.25); });
  EXPECT_THAT(line, MatchesRegex("[0-9-]+T[0-9:.]+ info cairn-test: mapped 3 in 0.2 ms\n"));
}

TEST(Log, LevelsBelowTheChosenOneAreSilent) {
  const auto write = [] {
    log::debug("one");
    log::info("two");
    log::warn("three");
  };
  EXPECT_EQ(logged("error", write), "");
  EXPECT_EQ(logged("off", write), "");
  EXPECT_THAT(logged("debug", write), HasSubstr("one"));
  const std::string warnings = logged("warn", write);
  EXPECT_THAT(warnings, HasSubstr("three"));
  EXPECT_THAT(warnings, ::testing::Not(HasSubstr("two")));
}

TEST(Log, UnknownLevelCountsAsInfo) {
  EXPECT_THAT(logged("loud", [] { log::info("heard"); }), HasSubstr("heard"));
  EXPECT_EQ(logged("loud", [] { log::debug("unheard"); }), "");
}

TEST(Log, AnUnknownLevelIsToldWithThoseThatThereAre) {
  for (const char* level : {"debug", "info", "warn", "error", "off"})
    EXPECT_TRUE(log::check_level(level).ok());
  EXPECT_EQ(log::check_level("Info").message(),
            "must be one of debug, info, warn, error, off; has 'Info'");
  EXPECT_FALSE(log::check_level("").ok());
}

}  // namespace
}  // namespace cairn
