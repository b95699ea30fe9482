#include "client/tracking/tracked_frame.h"

#include <gtest/gtest.h>

#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

TEST(TrackedFrame, ForgetsWithItsMatchesHowFarTheyWereOff) {
  testing::FeatureWorld world(5);
  const auto rig = testing::test_rig();
  TrackedFrame frame(0, rig, world.view(*rig, {}));
  ASSERT_GT(frame.features.size(), 1u);
  frame.matches[1] = {true, LandmarkId::from_feature({7, 1}, 1), {0, 0, 2}};
  frame.median_squared = 4;
  EXPECT_GT(frame.noise(), 1);
  EXPECT_EQ(frame.landmarks().size(), 1u);
  frame.clear_matches();
  EXPECT_EQ(frame.noise(), 1);
  EXPECT_TRUE(frame.landmarks().empty());
  EXPECT_EQ(frame.matches.size(), frame.features.size());
}

}  // namespace
}  // namespace cairn
