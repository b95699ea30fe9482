// A monocular client's tracker and the server's map, with keyframes and updates on their way while
// the scale changes.
#include <deque>

#include <gtest/gtest.h>

#include "client/tracking/tracker.h"
#include "server/map/apply.h"
#include "server/publish/publish.h"
#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

constexpr std::int64_t kFrameNs = 33'333'333;
constexpr std::uint64_t kEpoch = 99;
constexpr double kSpeed = 2.5;  // many keyframes in little time
const Sim3 kMove(so3_exp({0.1, 0.7, 0}), {4, -1, 2}, 1.7);

// Along a wall and back, looking at it, with slow turns.
Rigid3 stroll(double t) {
  return {so3_exp({0.05 * std::sin(0.9 * t), 0.15 * std::sin(0.7 * t), 0.03 * std::sin(t)}),
          {0.8 * std::sin(0.5 * t), 0.1 * std::sin(0.8 * t), 0.3 * std::sin(0.4 * t)}};
}

struct Wander {
  Wander() {
    map.id = {1};
    tracker.set_has_server(false);  // keyframes as often as without any lag
  }

  TrackingResult step() {
    TrackingResult r =
        tracker.track(kFrameNs * frame, world.view(*rig, stroll(kSpeed * frame / 30.0), 0.3, 10));
    ++frame;
    for (const KeyframePtr& k : {r.first_keyframe, r.keyframe})
      if (k) outbox.push_back(k);
    return r;
  }
  // All but so many keyframes reach the server.
  void deliver(std::size_t but) {
    for (; outbox.size() > but; outbox.pop_front(), ++mapped) apply_keyframe(map, outbox.front());
  }
  void tell() {
    if (const auto update = view.difference(map, mapped)) tracker.apply(*update);
  }
  void walk(int frames, std::size_t in_outbox = 0) {
    for (int i = 0; i < frames; ++i) {
      step();
      deliver(in_outbox);
      tell();
    }
  }
  // What the loop closer does when another part gives this one its scale; or a loop, of which each
  // keyframe gets a little more than the one before.
  void change_scale(bool merges, double growth = 0) {
    LoopClosure closure;
    closure.edge.query = {kEpoch, 1};
    closure.edge.candidate = {kEpoch, 0};
    closure.edge.merges = merges;
    closure.edge.new_map_from_old_map = kMove;
    if (merges) closure.edge.moved = {kEpoch};
    closure.correction = MapDelta::based_on(map);
    Sim3 move = merges ? kMove : Sim3();
    for (const KeyframeId id : map.keyframes.sorted_keys()) {
      const KeyframeNode& node = map.keyframes.at(id);
      if (!merges) move.scale += growth;
      closure.correction.poses.push_back(
          {id, node.map_from_camera, move.move_pose(node.map_from_camera), move.scale});
      for (const LandmarkId l : node.landmarks)
        if (l.is_valid() && map.landmarks.at(l).reference == id)
          closure.correction.positions.push_back({l, move * map.landmarks.at(l).position});
    }
    ASSERT_FALSE(apply_loop(map, closure).is_void);
  }
  // The farthest that client and server disagree about a keyframe.
  double disagreement() const {
    double worst = 0;
    for (std::uint32_t k = 0; k < mapped; ++k) {
      const Sim3 mine = *tracker.map().scaled_pose_of({kEpoch, k});
      const Sim3 servers = *map.scaled_pose_of({kEpoch, k});
      worst = std::max({worst, (mine.translation - servers.translation).norm(),
                        std::abs(mine.scale / servers.scale - 1)});
    }
    return worst;
  }
  // Of all frames, once the scale of the whole is taken out; metres.
  double error() const {
    std::vector<Eigen::Vector3d> found, truth;
    for (const StampedPose& p : tracker.trajectory()) {
      found.push_back(p.world_from_camera.translation);
      truth.push_back(stroll(kSpeed * static_cast<double>(p.stamp_ns) / 1e9).translation);
    }
    const auto aligned = align_points(found, truth, true);
    if (!aligned) return 1e9;
    double worst = 0;
    for (std::size_t i = 0; i < found.size(); ++i)
      worst = std::max(worst, (*aligned * found[i] - truth[i]).norm());
    return worst;
  }

  std::shared_ptr<const Rig> rig = testing::mono_test_rig();
  testing::FeatureWorld world{21, 6000};
  Tracker tracker{kEpoch, rig};
  Map map;
  ClientView view{kEpoch};
  std::deque<KeyframePtr> outbox;
  std::uint32_t mapped = 0;
  int frame = 0;
};

TEST(ScaleOnItsWay, WhatIsTrackedMovesWithItsPartAndDoesNotJump) {
  Wander run, plain;
  run.walk(90);
  plain.walk(90);
  const TrackingResult before = run.step();
  plain.step();
  run.change_scale(true);
  run.tell();
  EXPECT_LT(run.disagreement(), 1e-3);
  const TrackingResult after = run.step(), without = plain.step();
  ASSERT_EQ(after.state, TrackingState::kTracking);
  EXPECT_NEAR(after.landmarks, without.landmarks, 0.05 * without.landmarks);
  EXPECT_LT(
      (after.map_from_camera.translation - kMove * without.map_from_camera.translation).norm(),
      0.005);
  EXPECT_LT((after.odom_from_camera.translation - without.odom_from_camera.translation).norm(),
            0.005)
      << "odom keeps frame and unit";
  EXPECT_LT((after.odom_from_camera.translation - before.odom_from_camera.translation).norm(),
            0.03);
}

TEST(ScaleOnItsWay, KeyframesInTheOutboxComeToLieWhereTheyWere) {
  Wander run;
  run.walk(90, 2);
  run.change_scale(true);
  // The client does not hear of it yet and goes on in the old scale.
  for (int i = 0; i < 20; ++i) run.step();
  ASSERT_GE(run.outbox.size(), 3u) << "one made since";
  run.deliver(1);
  run.tell();
  EXPECT_LT(run.disagreement(), 1e-3);
  run.deliver(0);  // made before the client heard, came after it did
  run.walk(60);
  EXPECT_LT(run.disagreement(), 1e-3);
  EXPECT_EQ(run.tracker.trajectory().size(), 170u);
  EXPECT_LT(run.error(), 0.06);
}

TEST(ScaleOnItsWay, SeveralChangesAtOnce) {
  Wander run;
  run.walk(60, 2);
  run.change_scale(true);
  run.deliver(1);
  run.change_scale(true);
  for (int i = 0; i < 10; ++i) run.step();
  run.deliver(0);
  run.walk(60, 1);
  run.deliver(0);
  run.tell();
  EXPECT_LT(run.disagreement(), 1e-3);
  EXPECT_LT(run.error(), 0.06);
}

// The frames between keyframes go with their reference, each in its own scale.
TEST(ScaleOnItsWay, ALoopThatScalesKeyframesDifferentlyKeepsFramesBesideTheirKeyframes) {
  Wander run;
  run.walk(60, 2);
  const Trajectory before = run.tracker.trajectory();
  run.change_scale(false, 0.02);
  for (int i = 0; i < 10; ++i) run.step();
  run.deliver(0);
  run.tell();
  EXPECT_LT(run.disagreement(), 1e-3);
  EXPECT_EQ(run.step().state, TrackingState::kTracking);
  const Trajectory after = run.tracker.trajectory();
  for (std::size_t i = 1; i < before.size(); ++i) {
    const double step =
        (after[i].world_from_camera.translation - after[i - 1].world_from_camera.translation)
            .norm();
    EXPECT_LT(step, 0.06) << "frame " << i;
  }
}

// The server starts again without its map: odom is what both go by, in frame and unit.
TEST(ScaleOnItsWay, AServerWithoutItsMapGoesOnInOdomsUnit) {
  Wander run;
  run.walk(60);
  run.change_scale(true);
  run.tell();
  run.walk(30);
  for (int i = 0; i < 20; ++i) run.step();
  ASSERT_FALSE(run.outbox.empty());
  run.map = Map{};
  run.map.id = {2};
  run.view = ClientView{kEpoch};
  run.deliver(0);
  run.tell();
  const TrackingResult r = run.step();
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT((r.map_from_camera.translation - r.odom_from_camera.translation).norm(), 0.02);
  EXPECT_LT(run.error(), 0.06);
}

}  // namespace
}  // namespace cairn
