#include "server/optimize/global_ba.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

#include "server/map/apply.h"
#include "tests/unit/server/optimize/known_map.h"

namespace cairn {
namespace {

// Two clients' parts that do not meet, built as the server builds them.
struct TwoIslands {
  TwoIslands()
      : a({.keyframes = 12, .points = 500, .pixel_noise = 0.02}),
        b({.keyframes = 9, .points = 500, .seed = 5, .epoch = 9, .pixel_noise = 0.02}),
        truth(built(a)) {
    for (const auto& keyframe : b.keyframes) apply_keyframe(truth, keyframe);
    map = truth;
    disturb(map, free_keyframes(), 0.004, 0.01, 0.01);
  }
  std::vector<KeyframeId> free_keyframes() const {
    std::vector<KeyframeId> ids;
    for (const KeyframeId id : truth.keyframes.sorted_keys())
      if (id.sequence != 0) ids.push_back(id);
    return ids;
  }
  double worst_pose(const MapDelta& delta) const {
    double worst = 0;
    for (const auto& change : delta.poses)
      worst =
          std::max(worst, (change.map_from_camera.translation - true_pose(change.keyframe)).norm());
    return worst;
  }
  Eigen::Vector3d true_pose(KeyframeId id) const {
    return (id.epoch == a.options.epoch ? a : b).map_from_camera[id.sequence].translation;
  }
  SyntheticMap a, b;
  Map truth, map;
};

TEST(GlobalBa, FindsTheTrueMapFromADisturbedOne) {
  const TwoIslands islands;
  GlobalBaSummary summary;
  const MapDelta delta = solve_global_ba(islands.map, {}, {}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_EQ(summary.fixed_keyframes, 2);
  EXPECT_EQ(delta.poses.size(), 19u);
  EXPECT_LT(islands.worst_pose(delta), 2e-3);
  EXPECT_LT(summary.final_cost, 0.01 * summary.initial_cost);
}

TEST(GlobalBa, AdjustsOnlyThePartAskedFor) {
  const TwoIslands islands;
  const MapDelta delta = solve_global_ba(islands.map, {9, 4}, {});
  ASSERT_EQ(delta.poses.size(), 8u);
  for (const auto& change : delta.poses) {
    EXPECT_EQ(change.keyframe.epoch, 9u);
    EXPECT_NE(change.keyframe.sequence, 0u);
  }
  for (const auto& change : delta.positions)
    for (const auto& o : islands.map.landmarks.at(change.landmark).observations)
      EXPECT_EQ(o.keyframe.epoch, 9u);
}

TEST(GlobalBa, EveryLandmarkOfAMovedKeyframeIsPlaced) {
  TwoIslands islands;
  // One that is far off everywhere: nothing is left of it, so it goes along with its reference.
  LandmarkId lost;
  for (const LandmarkId id : islands.map.landmarks.sorted_keys()) {
    const Landmark& landmark = islands.map.landmarks.at(id);
    if (landmark.observations.size() < 3 || landmark.reference.sequence == 0) continue;
    lost = id;
    break;
  }
  ASSERT_TRUE(lost.is_valid());
  islands.map.landmarks.edit(lost)->position = {0, 0, -20};
  const MapDelta delta = solve_global_ba(islands.map, {}, {});
  std::multiset<LandmarkId> placed;
  for (const auto& change : delta.positions) placed.insert(change.landmark);
  EXPECT_EQ(placed.count(lost), 1u);
  for (const auto& change : delta.poses)
    for (const LandmarkId id : islands.map.keyframes.at(change.keyframe).landmarks)
      if (id.is_valid() && islands.map.landmarks.at(id).reference == change.keyframe) {
        EXPECT_EQ(placed.count(id), 1u);
      }
}

TEST(GlobalBa, ChangesNothingWhenStopped) {
  const TwoIslands islands;
  std::stop_source source;
  source.request_stop();
  GlobalBaSummary summary;
  const MapDelta delta = solve_global_ba(islands.map, {}, {}, &summary, source.get_token());
  EXPECT_TRUE(summary.stopped);
  EXPECT_LE(summary.iterations, 1);
  EXPECT_TRUE(delta.empty());
  EXPECT_EQ(delta.base_revision, islands.map.revision);
}

TEST(GlobalBa, UnknownPartHasNothingToSolve) {
  const TwoIslands islands;
  GlobalBaSummary summary;
  EXPECT_TRUE(solve_global_ba(islands.map, {77, 1}, {}, &summary).empty());
  EXPECT_FALSE(summary.message.empty());
}

TEST(GlobalBa, ResultFitsTheMapThatGoesOnGrowing) {
  TwoIslands islands;
  const Map snapshot = islands.map;
  const SyntheticMap more({.keyframes = 14, .points = 500, .pixel_noise = 0.02});
  apply_keyframe(islands.map, more.keyframes[12]);
  const MapDelta delta = solve_global_ba(snapshot, {}, {});
  const Rigid3 before = islands.map.keyframes.at({7, 12}).map_from_camera;
  const DeltaSummary applied = apply_delta(islands.map, delta);
  EXPECT_FALSE(applied.is_void);
  EXPECT_GT(applied.carried, 0);
  EXPECT_NE(islands.map.keyframes.at({7, 12}).map_from_camera.translation, before.translation);
}

}  // namespace
}  // namespace cairn
