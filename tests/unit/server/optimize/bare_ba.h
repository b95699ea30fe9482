// Bundle adjustment as one writes it with Ceres alone, on plain arrays: what ours is measured
// against. Knows nothing of maps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cairn::bare {

struct Observation {
  std::uint32_t camera = 0, point = 0;
  double u = 0, v = 0, disparity = 0;  // standard deviation 1
};

struct Problem {
  double fx = 0, fy = 0, cx = 0, cy = 0, fx_baseline = 0;
  std::vector<double> poses;   // map_from_camera, 7 a camera: quaternion x y z w, translation
  std::vector<double> points;  // 3 each
  std::vector<Observation> observations;

  const double* translation(std::size_t camera) const { return &poses[7 * camera + 4]; }
};

struct Summary {
  int iterations = 0;
  double initial_cost = 0, final_cost = 0;
};

// Where the derivatives come from: Ceres' dual numbers, or formulas written out by hand.
enum class Derivatives { kAutomatic, kAnalytic };

// Huber's loss, then least squares, each from where the former ended; the first camera is fixed.
Summary solve(Problem& problem, Derivatives derivatives, int first_iterations,
              int second_iterations, double function_tolerance);

}  // namespace cairn::bare
