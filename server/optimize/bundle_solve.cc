// The part of bundle adjustment that knows Ceres.
#include <algorithm>
#include <cmath>
#include <deque>

#include <ceres/ceres.h>

#include "common/util/clock.h"
#include "server/optimize/bundle_adjustment.h"
#include "server/optimize/rigid3_manifold.h"
#include "server/optimize/stop_callback.h"

namespace cairn {
namespace {

// Up to so many free poses the reduced system is solved as a dense one.
constexpr int kDenseLimit = 80;

template <int kRows>
class ReprojectionCost final : public ceres::SizedCostFunction<kRows, 7, 3> {
 public:
  explicit ReprojectionCost(const BundleProblem::Term& term) : term_(&term) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    double* by_pose = jacobians ? jacobians[0] : nullptr;
    double* by_point = jacobians ? jacobians[1] : nullptr;
    if (term_->active) {
      term_->reprojection.evaluate(parameters[0], parameters[1], residuals, by_pose, by_point);
      return true;
    }
    // Left out: weight zero keeps the problem's structure, so that nothing is built twice.
    std::fill_n(residuals, kRows, 0.0);
    if (by_pose) std::fill_n(by_pose, 7 * kRows, 0.0);
    if (by_point) std::fill_n(by_point, 3 * kRows, 0.0);
    return true;
  }

 private:
  const BundleProblem::Term* term_;
};

// Huber's loss that can be switched off for the second round.
class SwitchedHuber final : public ceres::LossFunction {
 public:
  explicit SwitchedHuber(double chi2_limit) : huber_(std::sqrt(chi2_limit)) {}
  void Evaluate(double squared_norm, double out[3]) const override {
    if (on) return huber_.Evaluate(squared_norm, out);
    out[0] = squared_norm;
    out[1] = 1;
    out[2] = 0;
  }
  bool on = true;

 private:
  ceres::HuberLoss huber_;
};

ceres::Problem::Options problem_options() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.disable_all_safety_checks = true;
  return options;
}

// A BundleProblem as Ceres sees it. The BundleProblem's vectors must not change their size while
// this lives.
class CeresBundle {
 public:
  explicit CeresBundle(BundleProblem& bundle) : bundle_(bundle), problem_(problem_options()) {
    order_ = std::make_shared<ceres::ParameterBlockOrdering>();
    for (auto& point : bundle.points) {
      problem_.AddParameterBlock(point.position.data(), 3);
      order_->AddElementToGroup(point.position.data(), 0);
    }
    for (auto& pose : bundle.poses) {
      problem_.AddParameterBlock(pose.state.data(), 7, &manifold_);
      if (pose.fixed) problem_.SetParameterBlockConstant(pose.state.data());
      order_->AddElementToGroup(pose.state.data(), 1);
    }
    for (const auto& term : bundle.terms) add(term);
  }

  ceres::Solver::Summary solve(const BundleOptions& options, int iterations, bool robust,
                               std::stop_token stop) {
    pixel_loss_.on = depth_loss_.on = robust;
    StopCallback callback(std::move(stop));
    ceres::Solver::Options solver;
    solver.linear_solver_type =
        free_poses() <= kDenseLimit ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
    solver.linear_solver_ordering = order_;
    solver.max_num_iterations = iterations;
    solver.function_tolerance = options.function_tolerance;
    solver.num_threads = options.num_threads;
    solver.logging_type = ceres::SILENT;
    solver.callbacks.push_back(&callback);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem_, &summary);
    return summary;
  }

 private:
  void add(const BundleProblem::Term& term) {
    double* pose = bundle_.poses[term.pose].state.data();
    double* point = bundle_.points[term.point].position.data();
    if (term.reprojection.has_depth())
      problem_.AddResidualBlock(&depth_costs_.emplace_back(term), &depth_loss_, pose, point);
    else
      problem_.AddResidualBlock(&pixel_costs_.emplace_back(term), &pixel_loss_, pose, point);
  }

  int free_poses() const {
    return static_cast<int>(std::count_if(bundle_.poses.begin(), bundle_.poses.end(),
                                          [](const auto& pose) { return !pose.fixed; }));
  }

  BundleProblem& bundle_;
  // Before problem_, which refers to them to its end. Deques, as cost functions can't be moved.
  Rigid3Manifold manifold_;
  SwitchedHuber pixel_loss_{Reprojection::kChi2Pixel};
  SwitchedHuber depth_loss_{Reprojection::kChi2Depth};
  std::deque<ReprojectionCost<2>> pixel_costs_;
  std::deque<ReprojectionCost<3>> depth_costs_;
  std::shared_ptr<ceres::ParameterBlockOrdering> order_;
  ceres::Problem problem_;
};

// Sets `active` for each observation by whether it agrees with the present state.
int mark_outliers(BundleProblem& problem) {
  int outliers = 0;
  for (auto& term : problem.terms) {
    const double chi2 = term.reprojection.chi2(problem.poses[term.pose].state.data(),
                                               problem.points[term.point].position.data());
    term.active = chi2 <= term.reprojection.chi2_limit();
    outliers += !term.active;
  }
  return outliers;
}

// Observations of points behind the camera have no useful derivative.
void leave_out_unseen(BundleProblem& problem) {
  for (auto& term : problem.terms)
    term.active = std::isfinite(term.reprojection.chi2(problem.poses[term.pose].state.data(),
                                                       problem.points[term.point].position.data()));
}

// Images alone don't tell how large a scene is. Where a single pose is held and no depth counts,
// the solver may end at any scale; this keeps the one that the cameras had, by their mean distance
// from the pose that is held.
class ScaleGauge {
 public:
  explicit ScaleGauge(const BundleProblem& problem) {
    for (const auto& term : problem.terms) known_ = known_ || term.reprojection.has_depth();
    for (const auto& pose : problem.poses) {
      if (!pose.fixed) continue;
      known_ = known_ || held_;
      held_ = &pose;
    }
    if (!known_ && held_) before_ = extent(problem);
  }

  void restore(BundleProblem& problem) const {
    if (known_ || !held_ || !(before_ > 0)) return;
    const double now = extent(problem);
    if (!(now > 0)) return;
    const Eigen::Vector3d centre = centre_of(*held_);
    const double factor = before_ / now;
    const auto scale = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
      return centre + factor * (p - centre);
    };
    for (auto& pose : problem.poses)
      Eigen::Map<Eigen::Vector3d>(pose.state.data() + 4) = scale(centre_of(pose));
    for (auto& point : problem.points) point.position = scale(point.position);
    for (auto& follower : problem.followers) follower.position_in_camera *= factor;
  }

 private:
  static Eigen::Vector3d centre_of(const BundleProblem::Pose& pose) {
    return to_rigid(pose.state).origin();
  }
  double extent(const BundleProblem& problem) const {
    double sum = 0;
    for (const auto& pose : problem.poses) sum += (centre_of(pose) - centre_of(*held_)).norm();
    return sum;
  }

  const BundleProblem::Pose* held_ = nullptr;
  bool known_ = false;
  double before_ = 0;
};

void describe(const BundleProblem& problem, BundleSummary& summary) {
  for (const auto& pose : problem.poses)
    ++(pose.fixed ? summary.fixed_keyframes : summary.keyframes);
  summary.landmarks = static_cast<int>(problem.points.size());
  summary.observations = static_cast<int>(problem.terms.size());
}

void add_round(const ceres::Solver::Summary& round, BundleSummary& summary) {
  summary.usable = round.IsSolutionUsable();
  summary.iterations += std::max(0, static_cast<int>(round.iterations.size()) - 1);
  summary.final_cost = round.final_cost;
  summary.message = round.message;
}

}  // namespace

BundleSummary solve_bundle(BundleProblem& problem, const BundleOptions& options,
                           std::stop_token stop) {
  const Stopwatch watch;
  BundleSummary summary;
  describe(problem, summary);
  if (problem.terms.empty() || summary.keyframes == 0) {
    summary.usable = true;
    summary.message = "nothing to solve: no free keyframe shares a landmark";
    return summary;
  }
  leave_out_unseen(problem);
  const ScaleGauge gauge(problem);
  CeresBundle bundle(problem);
  const auto first = bundle.solve(options, options.first_iterations, true, stop);
  summary.initial_cost = first.initial_cost;
  add_round(first, summary);
  if (summary.usable && !stop.stop_requested()) {
    mark_outliers(problem);
    add_round(bundle.solve(options, options.second_iterations, false, stop), summary);
  }
  gauge.restore(problem);
  summary.outliers = mark_outliers(problem);
  summary.stopped = stop.stop_requested();
  summary.solve_ms = watch.milliseconds();
  return summary;
}

}  // namespace cairn
