// Maps without a scale of their own, whose scale changes: what moves with it, and where keyframes
// come to lie that were made before.
#include <gmock/gmock.h>

#include "server/map/apply.h"
#include "server/map/connected.h"
#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

constexpr std::uint64_t kEpoch = 7;
const SyntheticOptions kMono{
    .keyframes = 6, .epoch = kEpoch, .sensor = Sensor::kMono, .step = 0.25};
const Sim3 kMove(so3_exp({0.1, 0.6, 0}), {3, -1, 2}, 1.8);

KeyframeId kf(std::uint32_t sequence) {
  return {kEpoch, sequence};
}

// Each keyframe names its landmarks after the first keyframe that has shown them, as a client does.
struct MonoRun {
  MonoRun() {
    std::vector<LandmarkId> names(world.points.size());
    for (std::size_t k = 0; k < world.keyframes.size(); ++k) {
      auto keyframe = std::make_shared<Keyframe>(*world.keyframes[k]);
      for (std::size_t f = 0; f < world.point_of[k].size(); ++f) {
        LandmarkId& name = names[static_cast<std::size_t>(world.point_of[k][f])];
        const auto feature = static_cast<std::uint16_t>(f);
        if (name.is_valid())
          keyframe->matches.push_back({feature, name});
        else
          name = LandmarkId::from_feature(keyframe->id, feature);
      }
      keyframes.push_back(std::move(keyframe));
    }
    map.id = {1};
  }
  void arrive(std::size_t first, std::size_t last) {
    for (std::size_t k = first; k < last; ++k) summary = apply_keyframe(map, keyframes[k]);
  }
  // The whole of it moves and is scaled, as by a merge.
  LoopClosure merge(const Sim3& move = kMove) const {
    LoopClosure closure;
    closure.edge.query = kf(1);
    closure.edge.candidate = kf(0);
    closure.edge.candidate_from_query = map.pose_of(kf(0))->inverse() * *map.pose_of(kf(1));
    closure.edge.new_map_from_old_map = move;
    closure.edge.moved = {kEpoch};
    closure.correction = MapDelta::based_on(map);
    map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
      closure.correction.poses.push_back(
          {id, node.map_from_camera, move.move_pose(node.map_from_camera), move.scale});
    });
    map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
      closure.correction.positions.push_back({id, move * landmark.position});
    });
    return closure;
  }
  // How far a keyframe is from where it would be had it come before the map was moved.
  double error_of(std::uint32_t k, const Sim3& move = kMove) const {
    return (map.pose_of(kf(k))->translation - move * world.map_from_camera[k].translation).norm();
  }

  SyntheticMap world{kMono};
  std::vector<std::shared_ptr<Keyframe>> keyframes;
  Map map;
  KeyframeSummary summary;
};

TEST(Scale, AMergeScalesAPartWithItsLandmarksAndTheirDistances) {
  MonoRun run;
  run.arrive(0, 4);
  const LandmarkId id = run.map.landmarks.sorted_keys()[10];
  const Landmark before = run.map.landmarks.at(id);
  ASSERT_FALSE(apply_loop(run.map, run.merge()).is_void);
  const Landmark& after = run.map.landmarks.at(id);
  EXPECT_LT((after.position - kMove * before.position).norm(), 1e-12);
  EXPECT_NEAR(after.max_distance / before.max_distance, kMove.scale, 1e-6);
  EXPECT_NEAR(after.min_distance / before.min_distance, kMove.scale, 1e-6);
  EXPECT_EQ(run.map.keyframes.at(kf(2)).unit, kMove.scale);
  EXPECT_LT(run.error_of(3), 1e-9);
  EXPECT_THAT(check_invariants(run.map), IsEmpty());
}

// In the client's outbox while its part was merged: nothing that they say knows of it.
TEST(Scale, KeyframesMadeBeforeAMergeComeToLieRightAfterIt) {
  MonoRun run;
  run.arrive(0, 3);
  apply_loop(run.map, run.merge());
  for (std::uint32_t k = 3; k < 6; ++k) {
    run.arrive(k, k + 1);
    EXPECT_LT(run.error_of(k), 1e-9);
    EXPECT_EQ(run.map.keyframes.at(kf(k)).unit, kMove.scale);
    EXPECT_GT(run.summary.accepted + run.summary.created, 60) << "its landmarks are where it looks";
    EXPECT_LT(run.summary.rejected, 10);
  }
  EXPECT_THAT(check_invariants(run.map), IsEmpty());
}

// The same keyframe as its client makes it once it has heard of the merge: its map has another unit
// by then, the reference's own is what it was.
TEST(Scale, AKeyframeMadeAfterAMergeComesToLieAtTheSamePlace) {
  MonoRun run;
  run.arrive(0, 3);
  apply_loop(run.map, run.merge());
  const Sim3 reference = run.map.keyframes.at(kf(2)).scaled_pose();
  const Rigid3 pose = kMove.move_pose(run.world.map_from_camera[3]);
  run.keyframes[3]->reference_from_camera = reference.inverse() * Sim3(pose);
  run.arrive(3, 4);
  EXPECT_LT(run.error_of(3), 1e-9);
  EXPECT_NEAR(run.map.keyframes.at(kf(3)).unit, 1, 1e-12);
}

TEST(Scale, MergesOneAfterTheOtherMultiply) {
  MonoRun run;
  run.arrive(0, 3);
  apply_loop(run.map, run.merge());
  apply_loop(run.map, run.merge(kMove));
  run.arrive(3, 4);
  EXPECT_LT(run.error_of(3, kMove * kMove), 1e-9);
}

TEST(Scale, AReferenceThatWasCulledBeforeOrAfterTheMergeServesAsWell) {
  for (const bool before : {true, false}) {
    MonoRun run;
    run.arrive(0, 3);
    if (before) {
      ASSERT_TRUE(remove_keyframe(run.map, kf(2)));
    }
    apply_loop(run.map, run.merge());
    if (!before) {
      ASSERT_TRUE(remove_keyframe(run.map, kf(2)));
    }
    EXPECT_LT(run.error_of(2), 1e-9);
    EXPECT_NEAR(run.map.scaled_pose_of(kf(2))->scale, kMove.scale, 1e-12);
    run.arrive(3, 4);
    EXPECT_LT(run.error_of(3), 1e-9);
  }
}

// Odometry keeps the unit that the run has begun with.
TEST(Scale, WithoutItsReferenceAKeyframeIsPlacedByOdometryInTheRightScale) {
  MonoRun run;
  run.arrive(0, 3);
  apply_loop(run.map, run.merge());
  run.keyframes[4]->reference = kf(3);  // which has not come
  run.arrive(4, 5);
  EXPECT_LT(run.error_of(4), 1e-9);
  EXPECT_NEAR(run.map.keyframes.at(kf(4)).unit, kMove.scale, 1e-12);

  // One that was made after the merge: a unit of odom's is larger for it.
  run.keyframes[5]->reference = kf(77);
  const Rigid3& odom = run.world.map_from_camera[5];
  run.keyframes[5]->odom_from_camera = Sim3(odom.rotation, odom.translation, 1 / kMove.scale);
  run.arrive(5, 6);
  EXPECT_LT(run.error_of(5), 1e-9);
  EXPECT_NEAR(run.map.keyframes.at(kf(5)).unit, 1, 1e-12);
}

TEST(Scale, WhatArrivedWhileALoopWasSolvedIsScaledWithItsReference) {
  MonoRun run;
  run.arrive(0, 3);
  const LoopClosure closure = run.merge();
  run.arrive(3, 5);
  std::vector<Landmark> late;
  run.map.landmarks.for_each([&](LandmarkId, const Landmark& l) {
    if (l.arrival > closure.correction.base_revision) late.push_back(l);
  });
  ASSERT_GT(late.size(), 20u);
  EXPECT_GT(apply_loop(run.map, closure).carried, 20);
  for (const std::uint32_t k : {3u, 4u}) {
    EXPECT_LT(run.error_of(k), 1e-9);
    EXPECT_NEAR(run.map.keyframes.at(kf(k)).unit, kMove.scale, 1e-12);
  }
  for (const Landmark& l : late) {
    const Landmark& now = run.map.landmarks.at(l.id);
    EXPECT_LT((now.position - kMove * l.position).norm(), 1e-9);
    EXPECT_NEAR(now.max_distance / l.max_distance, kMove.scale, 1e-5);
  }
}

TEST(Scale, ALoopsEdgeSaysWhatWasMeasuredWhateverTheScaleBecomes) {
  MonoRun run;
  run.arrive(0, 5);
  apply_loop(run.map, run.merge());
  const Sim3 measured = run.map.loops[0].candidate_from_query;
  apply_loop(run.map, run.merge());
  ASSERT_TRUE(remove_keyframe(run.map, kf(1)));
  const LoopEdge& edge = run.map.loops[0];
  ASSERT_NE(edge.query, kf(1));
  const Sim3 between = run.map.keyframes.at(edge.candidate).scaled_pose().inverse() *
                       run.map.keyframes.at(edge.query).scaled_pose();
  EXPECT_LT((edge.candidate_from_query.translation - between.translation).norm(), 1e-9);
  EXPECT_NEAR(edge.candidate_from_query.scale, 1, 1e-9);
  EXPECT_NEAR(measured.scale, 1, 1e-9);
}

TEST(Metric, APartIsOnceAKeyframeInItHasDepth) {
  MonoRun run;
  run.arrive(0, 3);
  const SyntheticMap other({.keyframes = 2, .epoch = 9});
  for (const KeyframePtr& keyframe : other.keyframes) apply_keyframe(run.map, keyframe);
  EXPECT_FALSE(is_metric(run.map, kf(1)));
  EXPECT_TRUE(is_metric(run.map, {9, 1}));
  EXPECT_FALSE(is_metric(run.map, {10, 1}));
  LoopClosure closure = run.merge();
  closure.edge.candidate = {9, 0};
  closure.edge.merges = true;
  std::erase_if(closure.correction.poses,
                [](const auto& change) { return change.keyframe.epoch == 9; });
  apply_loop(run.map, closure);
  EXPECT_TRUE(is_metric(run.map, kf(2)));
}

}  // namespace
}  // namespace cairn
