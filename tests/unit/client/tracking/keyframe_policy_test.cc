#include "client/tracking/keyframe_policy.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

// A view that the map explains well.
KeyframeSituation steady() {
  return {.frames_since_keyframe = 10,
          .shown_landmarks = 190,
          .reference_landmarks = 200,
          .near_tracked = 150,
          .near_new = 20,
          .backlog = 0};
}

TEST(KeyframePolicy, LeavesASteadyViewAlone) {
  KeyframeSituation now = steady();
  EXPECT_FALSE(wants_keyframe({}, now));
  now.frames_since_keyframe = 10'000;
  EXPECT_FALSE(wants_keyframe({}, now));
}

TEST(KeyframePolicy, TakesAKeyframeWhenLandmarksLeaveTheView) {
  KeyframeSituation now = steady();
  now.shown_landmarks = 60;
  EXPECT_TRUE(wants_keyframe({}, now));
}

TEST(KeyframePolicy, WaitsForTheMapperUnlessOverdueOrWeak) {
  KeyframeSituation now = steady();
  now.shown_landmarks = 60;
  now.backlog = 1;
  EXPECT_FALSE(wants_keyframe({}, now));
  now.frames_since_keyframe = 30;
  EXPECT_TRUE(wants_keyframe({}, now));
  now.backlog = 3;
  EXPECT_FALSE(wants_keyframe({}, now));
  now.shown_landmarks = 20;
  EXPECT_TRUE(wants_keyframe({}, now));
}

TEST(KeyframePolicy, TakesAKeyframeWhenNearPointsRunOut) {
  KeyframeSituation now = steady();
  now.near_tracked = 60;
  now.near_new = 100;
  EXPECT_TRUE(wants_keyframe({}, now));
  now.near_new = 50;  // nothing to add
  EXPECT_FALSE(wants_keyframe({}, now));
}

TEST(KeyframePolicy, KeepsTheLeastDistanceUnlessFewLandmarksAreLeft) {
  KeyframeSituation now = steady();
  now.shown_landmarks = 55;
  now.frames_since_keyframe = 4;
  EXPECT_FALSE(wants_keyframe({.min_frames_between = 5}, now));
  now.frames_since_keyframe = 5;
  EXPECT_TRUE(wants_keyframe({.min_frames_between = 5}, now));
  now.frames_since_keyframe = 1;
  now.shown_landmarks = 49;
  EXPECT_TRUE(wants_keyframe({.min_frames_between = 5}, now));
}

}  // namespace
}  // namespace cairn
