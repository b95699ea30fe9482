#include "client/tracking/tracker.h"

#include <gtest/gtest.h>

#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;
using testing::wander;

constexpr std::int64_t kFrameNs = 33'333'333;

struct Walk {
  std::shared_ptr<const Rig> rig = testing::test_rig();
  FeatureWorld world{11};
  Tracker tracker{99, rig};
  std::int64_t stamp = 0;

  TrackingResult step(const Rigid3& pose) {
    return tracker.track(stamp += kFrameNs, world.view(*rig, pose, 0.3, 10));
  }
  TrackingResult blind() { return tracker.track(stamp += kFrameNs, Features{}); }
};

TEST(Tracker, WaitsForAFrameWithDepthToStart) {
  Walk run;
  EXPECT_EQ(run.blind().state, TrackingState::kStarting);
  const TrackingResult first = run.step(wander(0));
  EXPECT_EQ(first.state, TrackingState::kTracking);
  ASSERT_TRUE(first.keyframe);
  EXPECT_EQ(first.keyframe->id, (KeyframeId{99, 0}));
  EXPECT_FALSE(first.keyframe->reference.is_valid());
}

TEST(Tracker, FollowsAWanderingCamera) {
  Walk run;
  run.tracker.set_has_server(false);
  const Rigid3 origin = wander(0);
  for (int i = 0; i < 300; ++i) {
    const Rigid3 truth = origin.inverse() * wander(i / 30.0);
    const TrackingResult r = run.step(wander(i / 30.0));
    ASSERT_EQ(r.state, TrackingState::kTracking) << "frame " << i;
    // It drifts past 5 cm after 231 frames, with 0.3 px of noise and no server to correct it.
    ASSERT_LT((r.map_from_camera.translation - truth.translation).norm(), 0.08) << "frame " << i;
  }
  EXPECT_GT(run.tracker.keyframes_made(), 5u);
  EXPECT_LT(run.tracker.keyframes_made(), 150u);
  EXPECT_EQ(run.tracker.trajectory().size(), 300u);
}

TEST(Tracker, IsLostWithoutFeaturesAndFindsItselfAgain) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 60; ++i) run.step(wander(i / 30.0));
  for (int i = 0; i < 10; ++i) EXPECT_EQ(run.blind().state, TrackingState::kLost);
  // Comes back somewhat elsewhere, where it has been before.
  bool found = false;
  Rigid3 pose = wander(0.5);
  for (int i = 0; i < 5 && !found; ++i) {
    const TrackingResult r = run.step(pose);
    found = r.state == TrackingState::kTracking;
    if (found) {
      const Rigid3 truth = wander(0).inverse() * pose;
      EXPECT_LT((r.map_from_camera.translation - truth.translation).norm(), 0.03);
    }
  }
  EXPECT_TRUE(found);
  EXPECT_EQ(run.tracker.trajectory().size(), 61u) << "lost frames have no pose";
}

TEST(Tracker, MatchesReportedWithAKeyframeAreAscendingAndOfTrueLandmarks) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 120; ++i) {
    const TrackingResult r = run.step(wander(i / 30.0));
    if (!r.keyframe) continue;
    for (std::size_t m = 1; m < r.keyframe->matches.size(); ++m)
      ASSERT_LT(r.keyframe->matches[m - 1].feature, r.keyframe->matches[m].feature);
    for (const LandmarkMatch& m : r.keyframe->matches) ASSERT_TRUE(m.landmark.is_valid());
  }
}

TEST(Tracker, CorrectionsMoveTheMapPoseButNotTheOdometry) {
  Walk run;
  TrackingResult r;
  for (int i = 0; i < 20; ++i) r = run.step(wander(i / 30.0));
  const Rigid3 odom_before = r.odom_from_camera;
  const Rigid3 map_before = r.map_from_camera;
  MapUpdate update;
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = 1;
  const Rigid3 shift(so3_exp({0, 0.1, 0}), {1, 2, 3});
  for (std::uint32_t s = 0; s < run.tracker.keyframes_made(); ++s)
    update.keyframes.push_back({{99, s}, shift * *run.tracker.map().pose_of({99, s})});
  run.tracker.apply(update);
  // The same view again: the pose has moved with the map, odometry has not.
  r = run.step(wander(19 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT(((shift * map_before).translation - r.map_from_camera.translation).norm(), 0.01);
  EXPECT_LT((odom_before.translation - r.odom_from_camera.translation).norm(), 0.01);
  // The written trajectory is the corrected one.
  EXPECT_LT(
      (run.tracker.trajectory().front().world_from_camera.translation - shift.translation).norm(),
      1e-9);
}

// A server that comes back without its map tells of an empty one, in whose frame odom is taken to
// be.
TEST(Tracker, GoesOnInItsOwnFrameWhenTheServerHasAnotherMap) {
  Walk run;
  TrackingResult r;
  for (int i = 0; i < 20; ++i) r = run.step(wander(i / 30.0));
  MapUpdate update;
  update.map = {1};
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = run.tracker.keyframes_made();
  const Rigid3 shift(so3_exp({0, 0.1, 0}), {1, 2, 3});
  for (std::uint32_t s = 0; s < run.tracker.keyframes_made(); ++s)
    update.keyframes.push_back({{99, s}, shift * *run.tracker.map().pose_of({99, s})});
  run.tracker.apply(update);
  r = run.step(wander(20 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  ASSERT_GT((r.map_from_camera.translation - r.odom_from_camera.translation).norm(), 1.0);

  MapUpdate other;
  other.map = {2};
  other.revision = 1;
  other.epoch = 99;
  run.tracker.apply(other);
  const Rigid3 odom_before = r.odom_from_camera;
  r = run.step(wander(20 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT((r.map_from_camera.translation - r.odom_from_camera.translation).norm(), 1e-9);
  EXPECT_LT((r.odom_from_camera.translation - odom_before.translation).norm(), 0.01);
  EXPECT_LT(run.tracker.trajectory().front().world_from_camera.translation.norm(), 1e-9);
}

// Fusion and culling leave little of what the client has named: most is of the server's making.
TEST(Tracker, IsNotLostWhenAllItSeesHadTheFormerServersNames) {
  Walk run;
  TrackingResult r;
  std::vector<LandmarkId> named;
  for (int i = 0; i < 20; ++i) {
    r = run.step(wander(i / 30.0));
    if (!r.keyframe) continue;
    for (const LandmarkMatch& m : r.keyframe->matches)
      if (m.landmark.creator() == r.keyframe->id) named.push_back(m.landmark);
  }
  MapUpdate update;
  update.map = {1};
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = run.tracker.keyframes_made();
  std::uint64_t number = 1;
  for (const LandmarkId id : named) {
    const LocalLandmark* l = run.tracker.map().find(id);
    LandmarkState made{.id = {LandmarkId::kServer, number++},
                       .position = l->position,
                       .normal = l->normal,
                       .min_distance = l->min_distance,
                       .max_distance = l->max_distance,
                       .descriptor = l->descriptor,
                       .observers = l->observers};
    update.landmarks.push_back(made);
    update.removed_landmarks.push_back({id, made.id});
  }
  run.tracker.apply(update);
  const int before = run.step(wander(20 / 30.0)).landmarks;
  MapUpdate other;
  other.map = {2};
  other.revision = 1;
  other.epoch = 99;
  run.tracker.apply(other);
  r = run.step(wander(21 / 30.0));
  EXPECT_EQ(r.state, TrackingState::kTracking);
  EXPECT_GT(r.landmarks, 0.9 * before);
}

// Keyframes of 4 s of the walk that nobody maps, where no view is so weak that it gets one anyway.
std::uint32_t keyframes_made(bool has_server) {
  TrackerOptions options;
  options.keyframes.min_shared = 0.9;
  options.keyframes.weak_shared = 0;
  options.keyframes.min_near_new = 1'000'000;
  const auto rig = testing::test_rig();
  FeatureWorld world{11};
  Tracker tracker(99, rig, options);
  tracker.set_has_server(has_server);
  for (int i = 0; i < 120; ++i)
    tracker.track(i * kFrameNs, world.view(*rig, wander(i / 30.0), 0.3, 10));
  EXPECT_EQ(tracker.unmapped(), static_cast<int>(tracker.keyframes_made()));
  return tracker.keyframes_made();
}

TEST(Tracker, WaitsForTheMapperOnlyWhileThereIsAServer) {
  EXPECT_EQ(keyframes_made(true), 3u) << "as many as may await mapping";
  EXPECT_GT(keyframes_made(false), 6u);
}

// What a restarted server says of its progress is less than its predecessor said, or too much of a
// lost map: neither makes anybody wait for keyframes that nobody will map.
TEST(Tracker, KeyframesCountAsMappedOnce) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 120; ++i) run.step(wander(i / 30.0));
  const auto made = run.tracker.keyframes_made();
  ASSERT_GE(made, 3u);
  MapUpdate update;
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = 2;
  run.tracker.apply(update);
  EXPECT_EQ(run.tracker.unmapped(), static_cast<int>(made) - 2);
  update.mapped_keyframes = 1;
  run.tracker.apply(update);
  EXPECT_EQ(run.tracker.keyframes_mapped(), 2u);
  run.tracker.write_off(made);
  run.tracker.write_off(1);
  EXPECT_EQ(run.tracker.unmapped(), 0);
}

}  // namespace
}  // namespace cairn
