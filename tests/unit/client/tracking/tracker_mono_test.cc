// A monocular camera through the whole tracker, without a server.
#include <gtest/gtest.h>

#include <cmath>

#include "client/tracking/tracker.h"
#include "common/geometry/sim3.h"
#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;

constexpr std::int64_t kFrameNs = 33'333'333;

// Along a wall and back, looking at it, with slow turns.
Rigid3 stroll(double t) {
  return {so3_exp({0.05 * std::sin(0.9 * t), 0.15 * std::sin(0.7 * t), 0.03 * std::sin(t)}),
          {0.8 * std::sin(0.5 * t), 0.1 * std::sin(0.8 * t), 0.3 * std::sin(0.4 * t)}};
}

struct Walk {
  std::shared_ptr<const Rig> rig = testing::mono_test_rig();
  FeatureWorld world{21, 6000};
  Tracker tracker{99, rig};
  std::vector<KeyframePtr> keyframes;
  std::int64_t stamp = 0;

  Walk() { tracker.set_has_server(false); }

  TrackingResult step(const Rigid3& pose) {
    const TrackingResult r = tracker.track(stamp, world.view(*rig, pose, 0.3, 10));
    stamp += kFrameNs;
    for (const KeyframePtr& k : {r.first_keyframe, r.keyframe})
      if (k) keyframes.push_back(k);
    return r;
  }

  // Of all frames with a pose, once the scale is taken out, metres.
  double error() const {
    std::vector<Eigen::Vector3d> found, truth;
    for (const StampedPose& p : tracker.trajectory()) {
      found.push_back(p.world_from_camera.translation);
      truth.push_back(stroll(static_cast<double>(p.stamp_ns) / 1e9).translation);
    }
    const auto aligned = align_points(found, truth, true);
    if (!aligned) return 1e9;
    double sum = 0;
    for (std::size_t i = 0; i < found.size(); ++i)
      sum += (*aligned * found[i] - truth[i]).squaredNorm();
    return std::sqrt(sum / static_cast<double>(found.size()));
  }
};

TEST(TrackerMono, StartsFollowsAndGivesEveryFrameAPose) {
  Walk walk;
  int earlier = 0, tracked = 0;
  for (int i = 0; i < 240; ++i) {
    const TrackingResult r = walk.step(stroll(i / 30.0));
    earlier += r.earlier_frames;
    tracked += r.state == TrackingState::kTracking;
  }
  EXPECT_EQ(earlier + tracked, 240);
  EXPECT_GT(tracked, 210);
  EXPECT_EQ(walk.tracker.trajectory().size(), 240u);
  EXPECT_LT(walk.error(), 0.03);
}

TEST(TrackerMono, ReportsLandmarksByTheEarlierKeyframesThatMadeThem) {
  Walk walk;
  for (int i = 0; i < 120; ++i) walk.step(stroll(i / 30.0));
  ASSERT_GE(walk.keyframes.size(), 4u);
  const Keyframe& first = *walk.keyframes[0];
  EXPECT_EQ(first.id, (KeyframeId{99, 0}));
  EXPECT_FALSE(first.reference.is_valid());
  EXPECT_TRUE(first.matches.empty());
  for (std::size_t k = 1; k < walk.keyframes.size(); ++k) {
    const Keyframe& keyframe = *walk.keyframes[k];
    EXPECT_EQ(keyframe.id.sequence, k);
    EXPECT_TRUE(keyframe.reference.is_valid());
    EXPECT_GE(keyframe.matches.size(), 40u);
    for (const LandmarkMatch& m : keyframe.matches) {
      EXPECT_LT(m.landmark.creator().sequence, keyframe.id.sequence);
      EXPECT_LT(m.landmark.creator_feature(),
                walk.keyframes[m.landmark.creator().sequence]->features.size());
    }
  }
}

// What it makes of two views lies where the points are, at one scale.
TEST(TrackerMono, ProvisionalLandmarksLieWhereTheirPointsAre) {
  Walk walk;
  for (int i = 0; i < 150; ++i) walk.step(stroll(i / 30.0));
  std::vector<Eigen::Vector3d> found, truth;
  FeatureWorld again{21, 6000};
  const Keyframe& last = *walk.keyframes.back();
  again.view(*walk.rig, stroll(static_cast<double>(last.stamp_ns) / 1e9));
  for (const LandmarkMatch& m : last.matches) {
    const LocalLandmark* landmark = walk.tracker.map().find(m.landmark);
    ASSERT_NE(landmark, nullptr);
    found.push_back(landmark->position);
    truth.push_back(again.point_of(m.feature));
  }
  ASSERT_GT(found.size(), 50u);
  const auto aligned = align_points(found, truth, true);
  ASSERT_TRUE(aligned);
  std::vector<double> errors;
  for (std::size_t i = 0; i < found.size(); ++i)
    errors.push_back((*aligned * found[i] - truth[i]).norm());
  std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.1);
}

TEST(TrackerMono, TheSameImagesGiveTheSameTrajectory) {
  Walk a, b;
  for (int i = 0; i < 60; ++i) {
    a.step(stroll(i / 30.0));
    b.step(stroll(i / 30.0));
  }
  const Trajectory first = a.tracker.trajectory(), second = b.tracker.trajectory();
  ASSERT_EQ(first.size(), second.size());
  ASSERT_FALSE(first.empty());
  for (std::size_t i = 0; i < first.size(); ++i)
    EXPECT_EQ(first[i].world_from_camera.translation, second[i].world_from_camera.translation);
}

}  // namespace
}  // namespace cairn
