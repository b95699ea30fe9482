#include "client/tracking/noise_level.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

double slack_after(double median_squared, int frames) {
  NoiseLevel level;
  for (int i = 0; i < frames; ++i) level.add(median_squared);
  return level.slack();
}

TEST(NoiseLevel, BeginsWithTheUsual) {
  EXPECT_DOUBLE_EQ(NoiseLevel().slack(), 1);
}

TEST(NoiseLevel, FollowsWhatTheViewsShow) {
  EXPECT_NEAR(slack_after(0.25, 100), std::sqrt(0.5), 1e-3);
}

TEST(NoiseLevel, IsHardlyMovedByOneBlurredFrame) {
  NoiseLevel level;
  for (int i = 0; i < 100; ++i) level.add(0.25);
  const double before = level.slack();
  level.add(1);
  EXPECT_LT(level.slack(), 1.15 * before);
}

// A view that is off by eleven times as much as those before it says little about the next one.
TEST(NoiseLevel, IsNotCarriedAwayByOneGrosslyBadFrame) {
  NoiseLevel level;
  for (int i = 0; i < 100; ++i) level.add(0.08);
  level.add(10);
  EXPECT_LT(level.slack(), 0.9);
  for (int i = 0; i < 10; ++i) level.add(0.08);
  EXPECT_LT(level.slack(), 0.6);
}

TEST(NoiseLevel, StaysInBounds) {
  EXPECT_DOUBLE_EQ(slack_after(0, 1000), 0.4);
  EXPECT_DOUBLE_EQ(slack_after(100, 1000), 1.2);
}

}  // namespace
}  // namespace cairn
