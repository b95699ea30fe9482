// Bundle adjustment as one writes it with Ceres alone, on plain arrays: what ours is measured
// against. Knows nothing of maps.
#pragma once

#include <cstdint>
#include <vector>

namespace cairn::bare {

struct Observation {
  std::uint32_t camera = 0, point = 0;
  double u = 0, v = 0, disparity = 0;  // standard deviation 1
};

struct Problem {
  double fx = 0, fy = 0, cx = 0, cy = 0, fx_baseline = 0;
  std::vector<double> rotations;     // map_from_camera, 4 a camera: x y z w
  std::vector<double> translations;  // 3 a camera
  std::vector<double> points;        // 3 each
  std::vector<Observation> observations;
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
