// Ours against a program of Ceres alone: the same problem must end at the same place.
#include "tests/unit/server/optimize/bare_ba.h"

#include <gtest/gtest.h>

#include "server/optimize/global_ba.h"
#include "tests/bench/ring_problem.h"

namespace cairn {
namespace {

// Small enough for a test; no observation is an outlier, as the plain program knows none.
RingWorld ring(int keyframes, int landmarks) {
  return RingWorld({.keyframes = keyframes,
                    .landmarks = landmarks,
                    .rounds = 2,
                    .sights = 6,
                    .pixel_noise = 0.05,
                    .turn_error = 0.002,
                    .move_error = 0.01,
                    .landmark_error = 0.02});
}

TEST(BareBa, AnalyticAndAutomaticDerivativesEndAlike) {
  bare::Problem automatic = bare_problem(ring(30, 800)), analytic = automatic;
  const auto a = bare::solve(automatic, bare::Derivatives::kAutomatic, 10, 20, 1e-8);
  const auto b = bare::solve(analytic, bare::Derivatives::kAnalytic, 10, 20, 1e-8);
  EXPECT_EQ(a.iterations, b.iterations);
  EXPECT_NEAR(a.initial_cost, b.initial_cost, 1e-9 * a.initial_cost);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-6 * a.final_cost);
  EXPECT_LT(b.final_cost, 0.01 * b.initial_cost);
  for (std::size_t i = 0; i < automatic.poses.size(); ++i)
    EXPECT_NEAR(automatic.poses[i], analytic.poses[i], 1e-6);
}

void expect_ours_ends_alike(const RingWorld& world) {
  bare::Problem problem = bare_problem(world);
  const auto plain = bare::solve(problem, bare::Derivatives::kAnalytic, 20, 20, 1e-10);
  GlobalBaOptions options;
  options.bundle = {.first_iterations = 20, .second_iterations = 20, .function_tolerance = 1e-10};
  GlobalBaSummary ours;
  const MapDelta delta = solve_global_ba(world.map, {}, options, &ours);
  EXPECT_EQ(ours.outliers, 0);
  EXPECT_NEAR(ours.final_cost, plain.final_cost, 1e-4 * plain.final_cost);
  ASSERT_EQ(delta.poses.size(), world.truth.size() - 1);
  for (const auto& change : delta.poses) {
    const double* t = problem.translation(change.keyframe.sequence);
    EXPECT_LT((change.map_from_camera.translation - Eigen::Vector3d(t[0], t[1], t[2])).norm(),
              1e-3);
  }
}

TEST(BareBa, OursEndsWhereThePlainProgramDoes) {
  expect_ours_ends_alike(ring(30, 800));
}

// Few of its keyframes see something in common.
TEST(BareBa, OursEndsWhereThePlainProgramDoesOnALargeRing) {
  expect_ours_ends_alike(ring(150, 4000));
}

}  // namespace
}  // namespace cairn
