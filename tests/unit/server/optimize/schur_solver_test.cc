#include "server/optimize/schur_solver.h"

#include <gtest/gtest.h>

#include "tests/unit/server/optimize/known_map.h"

namespace cairn {
namespace {

BundleProblem problem_of(Sensor sensor, std::size_t wrong_every = 0, double pixel_noise = 0.3) {
  const SyntheticMap world(
      {.keyframes = 8, .points = 300, .sensor = sensor, .pixel_noise = pixel_noise});
  Map map = known_map(world, 0, wrong_every);
  const LocalWindow window = window_of(world, map, 4);
  disturb(map, window.free_keyframes, 0.01, 0.02, 0.02);
  return extract_bundle(map, window.free_keyframes, window.fixed_keyframes, window.landmarks);
}

class SchurSolverOfSensor : public testing::TestWithParam<Sensor> {};
INSTANTIATE_TEST_SUITE_P(Sensors, SchurSolverOfSensor,
                         testing::Values(Sensor::kRgbd, Sensor::kStereo, Sensor::kMono));

TEST_P(SchurSolverOfSensor, EachRoundStartsWhereTheFormerEnded) {
  for (const bool robust : {true, false}) {
    BundleProblem problem = problem_of(GetParam(), robust ? 10 : 0);
    SchurSolver solver(problem);
    RoundSummary former = solver.solve({.max_iterations = 1, .robust = robust}, {});
    EXPECT_LT(former.final_cost, former.initial_cost);
    EXPECT_EQ(former.iterations, 1);
    for (int i = 0; i < 20; ++i) {
      const RoundSummary next = solver.solve({.max_iterations = 3, .robust = robust}, {});
      EXPECT_NEAR(next.initial_cost, former.final_cost, 1e-9 * former.final_cost);
      EXPECT_LE(next.final_cost, next.initial_cost);
      former = next;
    }
    EXPECT_EQ(former.message, "converged");
  }
}

// With true measurements each step of a right solver leaves a small fraction of the error; wrong
// derivatives would leave more.
TEST_P(SchurSolverOfSensor, AFewStepsTakeAwayTheErrorWhereNothingIsNoisy) {
  for (const bool robust : {true, false}) {
    BundleProblem problem = problem_of(GetParam(), 0, 0);
    const RoundSummary summary = SchurSolver(problem).solve(
        {.max_iterations = 7, .robust = robust, .function_tolerance = 0}, {});
    EXPECT_LT(summary.final_cost, 1e-6 * summary.initial_cost) << summary.final_cost;
  }
}

TEST(SchurSolver, WrongMatchesPullLessWithHubersLoss) {
  BundleProblem problem = problem_of(Sensor::kRgbd, 10);
  const double squared =
      SchurSolver(problem).solve({.max_iterations = 0, .robust = false}, {}).initial_cost;
  const double robust = SchurSolver(problem).solve({.max_iterations = 0}, {}).initial_cost;
  EXPECT_LT(robust, 0.2 * squared);
}

TEST(SchurSolver, WhatNoObservationHoldsStaysFinite) {
  for (const Sensor sensor : {Sensor::kRgbd, Sensor::kMono}) {
    BundleProblem problem = problem_of(sensor);
    // Of the first point no observation counts, of the second a single one, nor any of a camera.
    bool first_of_second = true;
    for (auto& term : problem.terms) {
      if (term.point == 0 || problem.poses[term.pose].id == problem.poses[0].id)
        term.active = false;
      else if (term.point == 1)
        term.active = std::exchange(first_of_second, false);
    }
    ASSERT_FALSE(problem.poses[0].fixed);
    const BundleProblem before = problem;
    const RoundSummary summary = SchurSolver(problem).solve({}, {});
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    EXPECT_EQ(problem.points[0].position, before.points[0].position);
    EXPECT_EQ(problem.poses[0].map_from_camera.translation,
              before.poses[0].map_from_camera.translation);
    for (const auto& pose : problem.poses) EXPECT_TRUE(pose.map_from_camera.is_finite());
    for (const auto& point : problem.points) EXPECT_TRUE(point.position.allFinite());
  }
}

TEST(SchurSolver, ACameraThatLooksAwayNeitherRaisesTheCostNorBreaksAnything) {
  BundleProblem problem = problem_of(Sensor::kMono);
  // Turned about, the camera sees nothing of what it should; its neighbour is far off.
  problem.poses[0].map_from_camera.rotation =
      so3_exp({0, 1.2, 0}) * problem.poses[0].map_from_camera.rotation;
  problem.poses[1].map_from_camera.translation += Eigen::Vector3d(0.5, 0, 1);
  const RoundSummary summary = SchurSolver(problem).solve({.max_iterations = 20}, {});
  EXPECT_LE(summary.final_cost, summary.initial_cost);
  for (const auto& pose : problem.poses) EXPECT_TRUE(pose.map_from_camera.is_finite());
}

TEST(SchurSolver, ChangesNothingWhenStoppedOrWithoutIterations) {
  BundleProblem problem = problem_of(Sensor::kRgbd);
  const BundleProblem before = problem;
  std::stop_source stopped;
  stopped.request_stop();
  const RoundSummary asked = SchurSolver(problem).solve({}, stopped.get_token());
  const RoundSummary none = SchurSolver(problem).solve({.max_iterations = 0}, {});
  EXPECT_EQ(asked.message, "asked to stop");
  EXPECT_EQ(none.final_cost, none.initial_cost);
  for (std::size_t i = 0; i < problem.points.size(); ++i)
    EXPECT_EQ(problem.points[i].position, before.points[i].position);
}

}  // namespace
}  // namespace cairn
