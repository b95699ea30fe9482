#include "common/util/clock.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Clock, NanosecondsToSeconds) {
  EXPECT_DOUBLE_EQ(to_seconds(1'500'000'000), 1.5);
  EXPECT_DOUBLE_EQ(to_seconds(kNanosPerSecond), 1.0);
}

TEST(Stopwatch, NeverRunsBackwards) {
  Stopwatch watch;
  const double first = watch.milliseconds(), second = watch.milliseconds();
  EXPECT_GE(first, 0);
  EXPECT_GE(second, first);
}

}  // namespace
}  // namespace cairn
