// One round of bundle adjustment: Levenberg-Marquardt with the landmarks eliminated (Schur
// complement; Triggs et al. 2000, section 6). Private to server/optimize.
//
// Why not Ceres, which solves the pose graph: a window of local mapping is solved for each few
// keyframes, and clients wait for it. Ceres builds problem and matrices anew each time and
// multiplies blocks of any size; here next to nothing is built, all blocks are of fixed size, and
// no Jacobian is ever written down. The same cost is minimised to the same minimum four to
// seven times faster (cairn_optimize_bench; bare_ba_test.cc compares the results).
#pragma once

#include <cstddef>
#include <stop_token>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "server/optimize/bundle_adjustment.h"
#include "server/optimize/pose_system.h"

namespace cairn {

struct RoundOptions {
  int max_iterations = 10;
  bool robust = true;  // Huber's loss
  double function_tolerance = 1e-4;
};

struct RoundSummary {
  int iterations = 0;  // steps tried
  // Half the sum of squared, perhaps robustified errors of the active terms. The last is never the
  // greater one.
  double initial_cost = 0, final_cost = 0;
  std::string message;
};

// Works in place on the state of a problem, which must outlive it and keep its size. Which terms
// are active may change between two rounds. Not thread-safe.
class SchurSolver {
 public:
  explicit SchurSolver(BundleProblem& problem);

  // Ends after the step at hand when asked to stop.
  RoundSummary solve(const RoundOptions& options, std::stop_token stop);

 private:
  using Matrix63 = Eigen::Matrix<double, 6, 3>;

  // What the poses and points are, and what a step would make of them.
  struct State {
    std::vector<Rigid3> poses;         // map_from_camera
    std::vector<CameraPlace> cameras;  // the same
    std::vector<Eigen::Vector3d> points;
  };
  struct PointBlock {
    Eigen::Matrix3d curvature;  // its block of the normal equations, not damped
    Eigen::Vector3d descent;    // negative gradient
    Eigen::Matrix3d inverse;    // of the damped block; zero where there is none
  };
  struct PoseBlock {
    Matrix6 curvature;
    Vector6 descent;
  };

  void load();
  void store();
  // Normal equations around `now_`; returns the cost there.
  double linearise(bool robust);
  double linearise_point(std::size_t point, bool robust);
  double cost(const State& state, bool robust) const;
  // False where the damped system has no solution.
  bool find_step(double damping);
  void eliminate_points(double damping);
  // Sets `next_`; returns by how much the cost falls if it is as curved as it is here.
  double take_step(double damping);
  // Calls f(which of the free poses, block between it and the point).
  template <typename F>
  void for_each_free_view(std::size_t point, F&& f) const;

  BundleProblem& problem_;
  std::vector<int> free_;  // by pose: which of the free ones it is, or kFixed
  // The terms of a point are first_term_[point] up to first_term_[point + 1].
  std::vector<std::size_t> first_term_;
  State now_, next_;
  std::vector<PointBlock> point_blocks_;
  std::vector<PoseBlock> pose_blocks_;  // of free poses
  std::vector<Matrix63> between_;       // by term; only those of active terms at free poses count
  PoseSystem system_;
};

}  // namespace cairn
