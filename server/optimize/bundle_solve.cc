// Bundle adjustment in two rounds: what contradicts the result of the first is left out of the
// second.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/util/clock.h"
#include "server/optimize/bundle_adjustment.h"
#include "server/optimize/schur_solver.h"

namespace cairn {
namespace {

// Calls f(term, squared norm of its errors in the present state).
template <typename F>
void for_each_error(BundleProblem& problem, F&& f) {
  std::vector<CameraPlace> cameras;
  for (const auto& pose : problem.poses) cameras.emplace_back(pose.map_from_camera);
  for (auto& term : problem.terms)
    f(term, term.reprojection.chi2(cameras[term.pose], problem.points[term.point].position));
}

// Sets `active` for each observation by whether it agrees with the present state.
int mark_outliers(BundleProblem& problem) {
  int outliers = 0;
  for_each_error(problem, [&](BundleProblem::Term& term, double chi2) {
    term.active = chi2 <= term.reprojection.chi2_limit();
    outliers += !term.active;
  });
  return outliers;
}

// Observations of points behind the camera have no useful derivative.
void leave_out_unseen(BundleProblem& problem) {
  for_each_error(problem,
                 [](BundleProblem::Term& term, double chi2) { term.active = std::isfinite(chi2); });
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
    for (auto& pose : problem.poses) pose.map_from_camera.translation = scale(centre_of(pose));
    for (auto& point : problem.points) point.position = scale(point.position);
    for (auto& follower : problem.followers) follower.position_in_camera *= factor;
  }

 private:
  static Eigen::Vector3d centre_of(const BundleProblem::Pose& pose) {
    return pose.map_from_camera.origin();
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

void add_round(const RoundSummary& round, BundleSummary& summary) {
  summary.iterations += round.iterations;
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
  SchurSolver solver(problem);
  RoundOptions round{.max_iterations = options.first_iterations,
                     .robust = true,
                     .function_tolerance = options.function_tolerance};
  const RoundSummary first = solver.solve(round, stop);
  summary.usable = std::isfinite(first.final_cost);
  summary.initial_cost = first.initial_cost;
  add_round(first, summary);
  if (summary.usable && !stop.stop_requested()) {
    mark_outliers(problem);
    round.max_iterations = options.second_iterations;
    round.robust = false;
    add_round(solver.solve(round, stop), summary);
  }
  gauge.restore(problem);
  summary.outliers = mark_outliers(problem);
  summary.stopped = stop.stop_requested();
  summary.solve_ms = watch.milliseconds();
  return summary;
}

}  // namespace cairn
