#include "server/optimize/pose_graph.h"

#include <algorithm>
#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/map/apply.h"
#include "tests/unit/server/optimize/ring_map.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Poses after the delta, of all keyframes.
std::map<KeyframeId, Rigid3> poses_after(const Map& map, const MapDelta& delta) {
  std::map<KeyframeId, Rigid3> poses;
  for (const KeyframeId id : map.keyframes.sorted_keys())
    poses[id] = map.keyframes.at(id).map_from_camera;
  for (const auto& change : delta.poses) poses[change.keyframe] = change.map_from_camera;
  return poses;
}

// Largest distance of a keyframe from where it should be, the first being where it is.
double worst(const RingMap& ring, std::map<KeyframeId, Rigid3> poses) {
  const Rigid3 map_from_first = poses.at(ring.id(0));
  double distance = 0;
  for (int k = 0; k < ring.options.keyframes; ++k) {
    const Rigid3 true_pose = map_from_first * ring.truth[static_cast<std::size_t>(k)];
    distance =
        std::max(distance, (true_pose.translation - poses.at(ring.id(k)).translation).norm());
  }
  return distance;
}

double gap(const RelativePose& loop, const std::map<KeyframeId, Rigid3>& poses) {
  const Rigid3 now = poses.at(loop.to).inverse() * poses.at(loop.from);
  return (now.translation - loop.to_from_from.translation).norm();
}

TEST(PoseGraph, ClosesADriftingRing) {
  const RingMap ring({.drift_rotation = 0.0015, .drift_translation = 0.01, .noise = 0.001});
  Map map;
  ring.add_to(map);
  const RelativePose loop = ring.loop(99, 0);
  ASSERT_GT(gap(loop, poses_after(map, {})), 0.5);
  PoseGraphSummary summary;
  const MapDelta delta = solve_pose_graph(map, {&loop, 1}, {}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_THAT(summary.rejected, IsEmpty());
  EXPECT_LT(gap(loop, poses_after(map, delta)), 0.005);
  EXPECT_LT(worst(ring, poses_after(map, delta)), 0.15 * worst(ring, poses_after(map, {})));
  EXPECT_EQ(summary.keyframes, 100);
  EXPECT_EQ(summary.loops, 1);
}

TEST(PoseGraph, LeavesARingAloneThatClosesAlready) {
  const RingMap ring({});
  Map map;
  ring.add_to(map);
  const RelativePose loop = ring.loop(99, 0);
  const auto poses = poses_after(map, solve_pose_graph(map, {&loop, 1}, {}));
  for (const auto& [id, pose] : poses)
    EXPECT_LT((pose.translation - map.keyframes.at(id).map_from_camera.translation).norm(), 1e-6);
}

TEST(PoseGraph, OneFalseLoopAmongTrueOnesIsLeftOut) {
  const RingMap ring({.drift_rotation = 0.001, .drift_translation = 0.01, .noise = 0.001});
  Map map;
  ring.add_to(map);
  std::vector<RelativePose> loops{ring.loop(99, 0), ring.loop(98, 1), ring.loop(97, 0),
                                  ring.loop(70, 20)};
  loops[3].to_from_from = Sim3(Rigid3{so3_exp({0, 0.1, 0}), {0.1, 0, 0.2}});
  PoseGraphSummary summary;
  const MapDelta delta = solve_pose_graph(map, loops, {}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_THAT(summary.rejected, ElementsAre(3u));
  const auto poses = poses_after(map, delta);
  for (int i = 0; i < 3; ++i) EXPECT_LT(gap(loops[static_cast<std::size_t>(i)], poses), 0.02);
  EXPECT_LT(worst(ring, poses), 0.3 * worst(ring, poses_after(map, {})));
}

TEST(PoseGraph, OnlyFalseLoopInAStiffMapIsLeftOut) {
  const RingMap ring({.noise = 0.001});
  Map map;
  ring.add_to(map);
  RelativePose loop = ring.loop(12, 8);
  loop.to_from_from = Sim3(Rigid3{so3_exp({0, 1.5, 0}), {3, 0, 2}});
  PoseGraphSummary summary;
  const auto poses = poses_after(map, solve_pose_graph(map, {&loop, 1}, {}, &summary));
  EXPECT_THAT(summary.rejected, ElementsAre(0u));
  for (const auto& [id, pose] : poses)
    EXPECT_LT((pose.translation - map.keyframes.at(id).map_from_camera.translation).norm(), 1e-3);
}

TEST(PoseGraph, LandmarksMoveWithTheirReference) {
  const RingMap ring({.drift_rotation = 0.0015, .drift_translation = 0.01});
  Map map;
  ring.add_to(map);
  const RelativePose loop = ring.loop(99, 0);
  const MapDelta delta = solve_pose_graph(map, {&loop, 1}, {});
  const auto poses = poses_after(map, delta);
  ASSERT_EQ(delta.positions.size(), 99u);
  for (const auto& change : delta.positions) {
    const KeyframeId reference = map.landmarks.at(change.landmark).reference;
    EXPECT_LT((poses.at(reference).inverse() * change.position - Eigen::Vector3d(0, 0, 2)).norm(),
              1e-9);
  }
}

// A ring of one client and half of a ring of another one that is somewhere else altogether.
struct TwoParts {
  TwoParts() : a({.noise = 0.001}), b(second()) {
    a.add_to(map);
    b.add_to(map);
  }
  static RingOptions second() {
    RingOptions o{.keyframes = 100, .noise = 0.001, .epoch = 9, .seed = 2};
    o.map_from_ring = {so3_exp({0.3, 2.8, -0.2}), {40, -3, 17}};
    return o;
  }
  // b's keyframe k stands where a's stands.
  RelativePose meet(int of_b, int of_a) const {
    return {b.id(of_b), a.id(of_a), Sim3(a.relative(of_a, of_b))};
  }
  RingMap a, b;
  Map map;
};

TEST(PoseGraph, JoinsPartsThatWereFarApart) {
  const TwoParts parts;
  const std::vector<RelativePose> loops{parts.meet(50, 48)};
  PoseGraphSummary summary;
  const MapDelta delta = solve_pose_graph(parts.map, loops, {}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_THAT(summary.rejected, IsEmpty());
  const auto poses = poses_after(parts.map, delta);
  EXPECT_LT(gap(loops[0], poses), 1e-6);
  for (int k = 30; k < 70; ++k) {
    const Rigid3 a_from_b = poses.at(parts.a.id(k)).inverse() * poses.at(parts.b.id(k));
    EXPECT_LT(a_from_b.translation.norm(), 0.05);
  }
  // One loop contradicts nothing: neither part is bent.
  for (int k = 0; k < 100; ++k)
    EXPECT_LT((poses.at(parts.a.id(k)).translation -
               parts.map.keyframes.at(parts.a.id(k)).map_from_camera.translation)
                  .norm(),
              1e-6);
}

TEST(PoseGraph, HoldsTheOldestKeyframeOfTheCandidatesSide) {
  const TwoParts parts;
  const std::vector<RelativePose> loops{parts.meet(50, 48)};
  std::set<KeyframeId> moved;
  for (const auto& change : solve_pose_graph(parts.map, loops, {}).poses)
    moved.insert(change.keyframe);
  EXPECT_EQ(moved.size(), 199u);
  EXPECT_FALSE(moved.contains(parts.a.id(0)));
  // The other way round it is the other side, though that is the younger one.
  const RelativePose turned{loops[0].to, loops[0].from, loops[0].to_from_from.inverse()};
  moved.clear();
  for (const auto& change : solve_pose_graph(parts.map, {&turned, 1}, {}).poses)
    moved.insert(change.keyframe);
  EXPECT_FALSE(moved.contains(parts.b.id(0)));
  EXPECT_TRUE(moved.contains(parts.a.id(0)));
}

TEST(PoseGraph, OfSeveralLoopsBetweenPartsTheFalseOneIsLeftOut) {
  const TwoParts parts;
  std::vector<RelativePose> loops{parts.meet(20, 60), parts.meet(50, 48), parts.meet(30, 31),
                                  parts.meet(70, 69)};
  loops[0].to_from_from = Sim3(Rigid3{so3_exp({0, 0.4, 0}), {0, 0, 0.5}});
  PoseGraphSummary summary;
  const auto poses = poses_after(parts.map, solve_pose_graph(parts.map, loops, {}, &summary));
  EXPECT_THAT(summary.rejected, ElementsAre(0u));
  for (std::size_t i = 1; i < 4; ++i) EXPECT_LT(gap(loops[i], poses), 0.02);
}

TEST(PoseGraph, PartsWithoutALoopStayAsTheyAre) {
  TwoParts parts;
  const RelativePose loop = parts.a.loop(99, 0);
  const MapDelta delta = solve_pose_graph(parts.map, {&loop, 1}, {});
  EXPECT_FALSE(delta.poses.empty());
  for (const auto& change : delta.poses) EXPECT_EQ(change.keyframe.epoch, parts.a.options.epoch);
  for (const auto& change : delta.positions)
    EXPECT_EQ(change.landmark.origin, parts.a.options.epoch);
}

TEST(PoseGraph, FindsTheScaleOfAPart) {
  // The second part believes everything to be half as large as it is.
  TwoParts parts;
  Map map;
  parts.a.add_to(map);
  for (Rigid3& pose : parts.b.estimate) pose.translation *= 0.5;
  parts.b.add_to(map);
  std::vector<RelativePose> loops{parts.meet(50, 48), parts.meet(10, 12)};
  for (auto& loop : loops) loop.to_from_from.scale = 2;
  PoseGraphSummary summary;
  const MapDelta delta = solve_pose_graph(map, loops, {.with_scale = true}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_THAT(summary.rejected, IsEmpty());
  const auto poses = poses_after(map, delta);
  for (int k = 5; k < 60; ++k) {
    const Rigid3 a_from_b = poses.at(parts.a.id(k)).inverse() * poses.at(parts.b.id(k));
    EXPECT_LT(a_from_b.translation.norm(), 0.08) << k;
  }
  // Two metres ahead of a keyframe of half the scale is four metres ahead.
  for (const auto& change : delta.positions) {
    if (change.landmark.origin != parts.b.options.epoch) continue;
    const Rigid3& pose = poses.at(map.landmarks.at(change.landmark).reference);
    EXPECT_NEAR((pose.inverse() * change.position).z(), 4, 0.05);
  }
}

// A single camera goes round once and believes everything to be a tenth smaller in the end.
struct ShrunkRing {
  ShrunkRing() {
    ring.add_to(map);
    loop = ring.loop(99, 0);
    loop.to_from_from.scale = 1 / ring.scale_at(99);
  }
  // The farthest that a keyframe lies from the truth once the loop is closed, metres.
  double error_after(const PoseGraphOptions& options) {
    LoopClosure closure;
    closure.edge.query = ring.id(99);
    closure.edge.candidate = ring.id(0);
    closure.correction = solve_pose_graph(map, {&loop, 1}, options);
    EXPECT_FALSE(apply_loop(map, closure).is_void);
    double worst = 0;
    for (int k = 0; k < 100; ++k)
      worst = std::max(worst, (map.pose_of(ring.id(k))->translation -
                               ring.truth[static_cast<std::size_t>(k)].translation)
                                  .norm());
    return worst;
  }
  RingMap ring{{.drift_scale = std::log(1.1)}};
  Map map;
  RelativePose loop;
};

TEST(PoseGraph, TakesTheDriftInScaleOutOfARing) {
  ShrunkRing run;
  EXPECT_LT(run.error_after({.with_scale = true}), 0.1);
  for (int k = 0; k < 100; ++k) {
    const KeyframeNode& node = run.map.keyframes.at(run.ring.id(k));
    EXPECT_NEAR(node.unit, 1 / run.ring.scale_at(k), 0.005) << k;
    const Eigen::Vector3d landmark = run.map.landmarks.at(run.ring.landmark(k)).position;
    EXPECT_NEAR((landmark - node.map_from_camera.translation).norm(), 2, 0.01) << k;
  }
  // The loop holds now, so that it asks for nothing more when another one is closed.
  const Sim3 between = run.map.keyframes.at(run.ring.id(0)).scaled_pose().inverse() *
                       run.map.keyframes.at(run.ring.id(99)).scaled_pose();
  EXPECT_NEAR(between.scale, run.loop.to_from_from.scale, 0.002);
  EXPECT_LT((between.translation - run.loop.to_from_from.translation).norm(), 0.01);

  ShrunkRing rigid;
  EXPECT_GT(rigid.error_after({.with_scale = false}), 0.2) << "there is something to take out";
}

TEST(PoseGraph, SkipsLoopsOfKeyframesThatAreGone) {
  const RingMap ring({});
  Map map;
  ring.add_to(map);
  RelativePose loop = ring.loop(99, 0);
  loop.from = {1234, 5};
  PoseGraphSummary summary;
  const MapDelta delta = solve_pose_graph(map, {&loop, 1}, {}, &summary);
  EXPECT_TRUE(delta.poses.empty());
  EXPECT_EQ(summary.loops, 0);
  EXPECT_FALSE(summary.message.empty());
  EXPECT_EQ(delta.base_revision, map.revision);
}

TEST(PoseGraph, ChangesNothingWhenStopped) {
  const RingMap ring({.drift_rotation = 0.0015});
  Map map;
  ring.add_to(map);
  const RelativePose loop = ring.loop(99, 0);
  std::stop_source source;
  source.request_stop();
  PoseGraphSummary summary;
  EXPECT_TRUE(solve_pose_graph(map, {&loop, 1}, {}, &summary, source.get_token()).poses.empty());
  EXPECT_TRUE(summary.stopped);
  EXPECT_LE(summary.iterations, 1);
}

TEST(PoseGraph, GivesTheSameResultEachTime) {
  const RingMap ring({.drift_rotation = 0.001, .noise = 0.003});
  Map map;
  ring.add_to(map);
  const RelativePose loop = ring.loop(99, 0);
  const MapDelta a = solve_pose_graph(map, {&loop, 1}, {}),
                 b = solve_pose_graph(map, {&loop, 1}, {});
  ASSERT_EQ(a.poses.size(), b.poses.size());
  for (std::size_t i = 0; i < a.poses.size(); ++i)
    ASSERT_EQ(a.poses[i].map_from_camera.matrix(), b.poses[i].map_from_camera.matrix());
}

}  // namespace
}  // namespace cairn
