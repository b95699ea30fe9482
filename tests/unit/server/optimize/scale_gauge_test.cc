// A part of a map without depth has no scale of its own: adjustment must leave it the one it has.
#include <gtest/gtest.h>

#include "server/map/apply.h"
#include "server/optimize/local_ba.h"
#include "tests/unit/server/optimize/known_map.h"

namespace cairn {
namespace {

double mean_distance_from_first(const Map& map) {
  const std::vector<KeyframeId> ids = map.keyframes.sorted_keys();
  const Eigen::Vector3d first = map.keyframes.at(ids.front()).map_from_camera.origin();
  double sum = 0;
  for (const KeyframeId id : ids)
    sum += (map.keyframes.at(id).map_from_camera.origin() - first).norm();
  return sum / static_cast<double>(ids.size());
}

LocalWindow all_but_the_first(const Map& map) {
  LocalWindow window;
  window.free_keyframes = map.keyframes.sorted_keys();
  window.fixed_keyframes = {window.free_keyframes.front()};
  window.free_keyframes.erase(window.free_keyframes.begin());
  window.landmarks = map.landmarks.sorted_keys();
  return window;
}

TEST(ScaleGauge, StaysWhereOneCameraIsHeldAndNothingTellsTheScale) {
  const SyntheticMap world(
      {.keyframes = 6, .points = 400, .sensor = Sensor::kMono, .pixel_noise = 0.5});
  Map map = known_map(world);
  disturb(map, all_but_the_first(map).free_keyframes, 0.005, 0.02, 0.05);
  for (int round = 0; round < 10; ++round) {
    const double before = mean_distance_from_first(map);
    LocalBaSummary summary;
    const MapDelta delta = solve_local_ba(map, all_but_the_first(map), {}, &summary);
    ASSERT_TRUE(summary.usable) << summary.message;
    ASSERT_EQ(delta.poses.size(), 5u);
    apply_delta(map, delta);
    EXPECT_NEAR(mean_distance_from_first(map) / before, 1, 1e-9);
  }
}

// Rescaled poses and points must still fit: the last solution's error is noise alone.
TEST(ScaleGauge, KeepsTheSolution) {
  const SyntheticMap world(
      {.keyframes = 6, .points = 400, .sensor = Sensor::kMono, .pixel_noise = 0.01});
  Map map = known_map(world);
  disturb(map, all_but_the_first(map).free_keyframes, 0.005, 0.03, 0.05);
  apply_delta(map, solve_local_ba(map, all_but_the_first(map), {}));
  LocalBaSummary summary;
  solve_local_ba(map, all_but_the_first(map), {}, &summary);
  EXPECT_EQ(summary.outliers, 0);
  EXPECT_LT(summary.initial_cost, 0.01 * summary.observations);
}

// Depth knows the scale: a map that is a tenth too large shrinks.
TEST(ScaleGauge, GivesWayToDepth) {
  const SyntheticMap world({.keyframes = 6, .points = 400, .pixel_noise = 0.1});
  Map map = known_map(world);
  const double truth = mean_distance_from_first(map);
  for (const KeyframeId id : map.keyframes.sorted_keys())
    map.keyframes.edit(id)->map_from_camera.translation *= 1.1;
  for (const LandmarkId id : map.landmarks.sorted_keys()) map.landmarks.edit(id)->position *= 1.1;
  apply_delta(map, solve_local_ba(map, all_but_the_first(map), {}));
  EXPECT_NEAR(mean_distance_from_first(map) / truth, 1, 0.02);
}

}  // namespace
}  // namespace cairn
