#include "client/tracking/pose_solver.h"

#include <gtest/gtest.h>

#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;

std::vector<PoseObservation> observe(FeatureWorld& world, const Rig& rig, const Rigid3& pose,
                                     double sigma, bool with_depth = true) {
  const Features features = world.view(rig, pose, sigma);
  std::vector<PoseObservation> observations;
  for (std::size_t i = 0; i < features.size(); ++i)
    observations.push_back({world.point_of(i),
                            features.points[i].pixel(),
                            with_depth ? features.points[i].disparity : 0,
                            {1, 1}});
  return observations;
}

Rigid3 disturbed(const Rigid3& pose, double angle, double distance) {
  Eigen::Matrix<double, 6, 1> delta;
  delta << angle, -angle, angle, distance, distance, -distance;
  return perturbed(pose, delta);
}

double distance(const Rigid3& a, const Rigid3& b) {
  return (a.translation - b.translation).norm();
}

TEST(PoseSolver, FindsTheExactPoseFromExactPoints) {
  FeatureWorld world(1);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(1.0);
  const auto observations = observe(world, *rig, truth, 0);
  const PoseSolution s = solve_pose(rig->camera, disturbed(truth, 0.03, 0.05), observations);
  EXPECT_LT(distance(s.map_from_camera, truth), 1e-6);
  EXPECT_LT(rotation_angle(s.map_from_camera.inverse() * truth), 1e-6);
  EXPECT_EQ(s.inliers, static_cast<int>(observations.size()));
}

// The median of a chi-square of two degrees of freedom is 2 ln 2 = 1.39.
TEST(PoseSolver, MeasuresThePrecisionOfTheView) {
  for (const double sigma : {0.5, 1.0, 2.0}) {
    FeatureWorld world(4);
    const auto rig = testing::test_rig();
    const Rigid3 truth = testing::wander(1.0);
    const auto observations = observe(world, *rig, truth, sigma);
    const PoseSolution s = solve_pose(rig->camera, truth, observations);
    EXPECT_NEAR(s.median_squared, 1.39 * sigma * sigma, 0.3 * sigma * sigma) << sigma;
  }
}

TEST(PoseSolver, WorksWithoutDepth) {
  FeatureWorld world(2);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(2.0);
  const auto observations = observe(world, *rig, truth, 0, false);
  const PoseSolution s = solve_pose(rig->camera, disturbed(truth, 0.03, 0.05), observations);
  EXPECT_LT(distance(s.map_from_camera, truth), 1e-5);
}

TEST(PoseSolver, SortsOutWrongMatches) {
  FeatureWorld world(3);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(0.5);
  auto observations = observe(world, *rig, truth, 0.5);
  std::uniform_real_distribution<double> off(20, 60);
  const std::size_t wrong = observations.size() * 2 / 5;
  for (std::size_t i = 0; i < wrong; ++i) {
    observations[i].pixel.x() += off(world.random());
    observations[i].disparity = 0;
  }
  const PoseSolution s = solve_pose(rig->camera, disturbed(truth, 0.02, 0.03), observations);
  EXPECT_LT(distance(s.map_from_camera, truth), 0.005);
  for (std::size_t i = 0; i < wrong; ++i) EXPECT_FALSE(s.is_inlier[i]);
  EXPECT_GT(s.inliers, static_cast<int>(0.9 * static_cast<double>(observations.size() - wrong)));
}

TEST(PoseSolver, TakesForWrongWhatLiesBeyondTheSlack) {
  FeatureWorld world(6);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(0.5);
  auto observations = observe(world, *rig, truth, 0.2);
  observations[0].pixel.x() += 1.6;
  EXPECT_TRUE(solve_pose(rig->camera, truth, observations).is_inlier[0]);
  const PoseSolution strict = solve_pose(rig->camera, truth, observations, 0.5);
  EXPECT_FALSE(strict.is_inlier[0]);
  EXPECT_EQ(strict.inliers, static_cast<int>(observations.size()) - 1);
}

TEST(PoseSolver, CountsPointsBehindTheCameraAsOutliers) {
  FeatureWorld world(4);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(0);
  auto observations = observe(world, *rig, truth, 0);
  observations[0].point_in_map = truth * Eigen::Vector3d(0, 0, -1);
  const PoseSolution s = solve_pose(rig->camera, truth, observations);
  EXPECT_FALSE(s.is_inlier[0]);
  EXPECT_EQ(s.inliers, static_cast<int>(observations.size()) - 1);
}

TEST(PoseSolver, LeavesThePoseAloneWithTooFewPoints) {
  FeatureWorld world(5);
  const auto rig = testing::test_rig();
  const Rigid3 truth = testing::wander(0);
  auto observations = observe(world, *rig, truth, 0);
  observations.resize(2);
  const Rigid3 start = disturbed(truth, 0.1, 0.1);
  const PoseSolution s = solve_pose(rig->camera, start, observations);
  EXPECT_EQ(s.inliers, 0);
  EXPECT_EQ(distance(s.map_from_camera, start), 0);
}

}  // namespace
}  // namespace cairn
