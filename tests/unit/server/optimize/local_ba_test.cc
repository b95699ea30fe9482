#include "server/optimize/local_ba.h"

#include <algorithm>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "tests/unit/server/optimize/known_map.h"

namespace cairn {
namespace {

struct Scene {
  explicit Scene(Sensor sensor, std::size_t wrong_every = 0, double pixel_noise = 0.3)
      : world({.keyframes = 8, .points = 400, .sensor = sensor, .pixel_noise = pixel_noise}),
        truth(known_map(world, 0, wrong_every)),
        map(truth),
        window(window_of(world, map, 4)) {}

  // The largest errors of the poses that a delta names.
  std::pair<double, double> errors(const MapDelta& delta) const {
    double rotation = 0, translation = 0;
    for (const auto& change : delta.poses) {
      const Rigid3& true_pose = truth.keyframes.at(change.keyframe).map_from_camera;
      const Rigid3 error = true_pose.inverse() * change.map_from_camera;
      rotation = std::max(rotation, rotation_angle(error));
      translation = std::max(translation, error.translation.norm());
    }
    return {rotation, translation};
  }

  SyntheticMap world;
  Map truth, map;
  LocalWindow window;
};

class LocalBaOfSensor : public testing::TestWithParam<Sensor> {};
INSTANTIATE_TEST_SUITE_P(Sensors, LocalBaOfSensor,
                         testing::Values(Sensor::kRgbd, Sensor::kStereo, Sensor::kMono));

TEST_P(LocalBaOfSensor, FindsTheTrueStateFromADisturbedOne) {
  Scene scene(GetParam(), 0, 0.01);
  disturb(scene.map, scene.window.free_keyframes, 0.01, 0.03, 0.03);
  LocalBaSummary summary;
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {}, &summary);
  ASSERT_TRUE(summary.usable) << summary.message;
  ASSERT_EQ(delta.poses.size(), 4u);
  const auto [rotation, translation] = scene.errors(delta);
  EXPECT_LT(rotation, 1e-4);
  EXPECT_LT(translation, 5e-4);
  EXPECT_EQ(summary.outliers, 0);
  std::vector<double> distances;
  for (const auto& change : delta.positions)
    distances.push_back(
        (change.position - scene.truth.landmarks.at(change.landmark).position).norm());
  ASSERT_GT(distances.size(), 200u);
  std::nth_element(distances.begin(), distances.begin() + 100, distances.end());
  EXPECT_LT(distances[100], 2e-3);
}

TEST_P(LocalBaOfSensor, WrongMatchesNeitherBendTheResultNorStay) {
  Scene scene(GetParam(), 25);
  disturb(scene.map, scene.window.free_keyframes, 0.005, 0.01, 0.01);
  LocalBaSummary summary;
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {}, &summary);
  const auto [rotation, translation] = scene.errors(delta);
  EXPECT_LT(rotation, 2e-3);
  EXPECT_LT(translation, 8e-3);
  EXPECT_GT(summary.outliers, summary.observations / 50);
  EXPECT_LT(summary.outliers, summary.observations / 10);
  EXPECT_EQ(delta.removed_observations.size(), static_cast<std::size_t>(summary.outliers));
}

TEST(LocalBa, SaysWhatItWasBasedOn) {
  Scene scene(Sensor::kRgbd);
  scene.map.revision = 77;
  scene.map.merge_epoch = 3;
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {});
  EXPECT_EQ(delta.base_revision, 77u);
  EXPECT_EQ(delta.base_merge_epoch, 3u);
  for (const auto& change : delta.poses) {
    const Rigid3& old_pose = scene.map.keyframes.at(change.keyframe).map_from_camera;
    EXPECT_EQ(change.old_map_from_camera.translation, old_pose.translation);
  }
}

TEST(LocalBa, LeavesFixedKeyframesAlone) {
  Scene scene(Sensor::kRgbd);
  disturb(scene.map, scene.window.free_keyframes, 0.01, 0.02, 0.01);
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {});
  for (const auto& change : delta.poses)
    EXPECT_FALSE(std::binary_search(scene.window.fixed_keyframes.begin(),
                                    scene.window.fixed_keyframes.end(), change.keyframe));
}

TEST(LocalBa, HoldsTheOldestKeyframeWhenNoneIsFixed) {
  Scene scene(Sensor::kRgbd);
  scene.window.fixed_keyframes.clear();
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {});
  ASSERT_EQ(delta.poses.size(), 3u);
  const KeyframeId oldest = scene.window.free_keyframes.front();
  for (const auto& change : delta.poses) EXPECT_NE(change.keyframe, oldest);
}

TEST(LocalBa, GivesTheSameResultEachTime) {
  Scene scene(Sensor::kStereo, 25);
  disturb(scene.map, scene.window.free_keyframes, 0.01, 0.02, 0.01);
  const MapDelta a = solve_local_ba(scene.map, scene.window, {});
  const MapDelta b = solve_local_ba(scene.map, scene.window, {});
  ASSERT_EQ(a.positions.size(), b.positions.size());
  for (std::size_t i = 0; i < a.positions.size(); ++i)
    ASSERT_EQ(a.positions[i].position, b.positions[i].position);
  for (std::size_t i = 0; i < a.poses.size(); ++i)
    ASSERT_EQ(a.poses[i].map_from_camera.matrix(), b.poses[i].map_from_camera.matrix());
}

TEST(LocalBa, LandmarkOfASingleViewMovesWithItsKeyframe) {
  Scene scene(Sensor::kRgbd);
  const KeyframeId last = scene.window.free_keyframes.back();
  const LandmarkId lone{LandmarkId::kServer, 100000};
  Landmark landmark;
  landmark.id = lone;
  landmark.observations = {{last, 0}};
  landmark.position = scene.map.keyframes.at(last).map_from_camera * Eigen::Vector3d(0.2, 0.1, 3);
  disturb(scene.map, {last}, 0.01, 0.05, 0);
  landmark.position = scene.map.keyframes.at(last).map_from_camera * Eigen::Vector3d(0.2, 0.1, 3);
  scene.map.landmarks.insert(lone, landmark);
  scene.window.landmarks.insert(scene.window.landmarks.end(), lone);
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {});

  std::map<KeyframeId, Rigid3> poses;
  for (const auto& change : delta.poses) poses[change.keyframe] = change.map_from_camera;
  const auto moved = std::find_if(delta.positions.begin(), delta.positions.end(),
                                  [&](const auto& change) { return change.landmark == lone; });
  ASSERT_NE(moved, delta.positions.end());
  EXPECT_LT((poses[last].inverse() * moved->position - Eigen::Vector3d(0.2, 0.1, 3)).norm(), 1e-9);
}

TEST(LocalBa, PointBehindACameraIsAnOutlierThere) {
  Scene scene(Sensor::kRgbd);
  const LandmarkId id = landmark_of_point(scene.world.point_of.back().front());
  scene.map.landmarks.edit(id)->position = {0, 0, -5};
  LocalBaSummary summary;
  const MapDelta delta = solve_local_ba(scene.map, scene.window, {}, &summary);
  EXPECT_TRUE(summary.usable);
  std::size_t removed = 0;
  for (const auto& gone : delta.removed_observations) removed += gone.landmark == id;
  EXPECT_EQ(removed, scene.map.landmarks.at(id).observations.size());
  for (const auto& change : delta.positions) EXPECT_NE(change.landmark, id);
  const auto [rotation, translation] = scene.errors(delta);
  EXPECT_LT(translation, 8e-3);
}

TEST(LocalBa, SkipsWhatTheMapDoesNotHold) {
  Scene scene(Sensor::kRgbd);
  scene.window.free_keyframes.push_back({99, 0});
  scene.window.landmarks.push_back({99, 1});
  LocalBaSummary summary;
  EXPECT_EQ(solve_local_ba(scene.map, scene.window, {}, &summary).poses.size(), 4u);
  EXPECT_EQ(summary.keyframes, 4);
}

TEST(LocalBa, EmptyWindowChangesNothing) {
  const Scene scene(Sensor::kRgbd);
  LocalBaSummary summary;
  EXPECT_TRUE(solve_local_ba(scene.map, {}, {}, &summary).poses.empty());
  EXPECT_FALSE(summary.message.empty());
}

TEST(LocalBa, EndsAtOnceWhenAskedToStop) {
  Scene scene(Sensor::kRgbd);
  disturb(scene.map, scene.window.free_keyframes, 0.01, 0.02, 0.01);
  std::stop_source source;
  source.request_stop();
  LocalBaSummary summary;
  solve_local_ba(scene.map, scene.window, {}, &summary, source.get_token());
  EXPECT_TRUE(summary.stopped);
  EXPECT_LE(summary.iterations, 1);
}

TEST(BundleAdjustment, WholeMapFindsTheTruth) {
  SyntheticMap world({.keyframes = 90, .points = 150, .step = 0.02, .pixel_noise = 0.01});
  const Map truth = known_map(world);
  Map map = truth;
  std::vector<KeyframeId> free = map.keyframes.sorted_keys();
  disturb(map, {free.begin() + 1, free.end()}, 0.002, 0.005, 0.005);
  const auto landmarks = map.landmarks.sorted_keys();
  BundleProblem problem = extract_bundle(map, free, {}, landmarks);
  const BundleSummary summary = solve_bundle(problem, {});
  ASSERT_TRUE(summary.usable) << summary.message;
  EXPECT_EQ(summary.fixed_keyframes, 1);
  double worst = 0;
  for (const auto& change : bundle_delta(map, problem).poses)
    worst = std::max(worst, (change.map_from_camera.translation -
                             truth.keyframes.at(change.keyframe).map_from_camera.translation)
                                .norm());
  EXPECT_LT(worst, 5e-3);
}

}  // namespace
}  // namespace cairn
