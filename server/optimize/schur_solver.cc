#include "server/optimize/schur_solver.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

namespace cairn {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kFixed = -1;
// What Marquardt's damping multiplies is no smaller than this, for directions that nothing
// measures.
constexpr double kLeastCurvature = 1e-6;
constexpr double kFirstDamping = 1e-4, kLeastDamping = 1e-12, kMostDamping = 1e12;
// A step is taken from so large a share of the expected fall.
constexpr double kLeastGain = 1e-3;

// Huber's loss of a squared error, twice its cost, and its derivative, by which the error weighs.
struct Loss {
  double value, weight;
};

Loss huber(double squared, double limit) {
  if (squared <= limit) return {squared, 1};
  const double ratio = std::sqrt(limit / squared);
  return {2 * ratio * squared - limit, ratio};
}

Loss loss_of(const BundleProblem::Term& term, const double* errors, bool robust) {
  double squared = errors[0] * errors[0] + errors[1] * errors[1];
  if (term.reprojection.has_depth()) squared += errors[2] * errors[2];
  return robust ? huber(squared, term.reprojection.chi2_limit()) : Loss{squared, 1};
}

// What an observation adds to the normal equations of its point. For a row a of its derivatives by
// the point, that by the pose is G a with G = [-[o]x; -I], o from the camera's centre to the point
// (reprojection.h). With A, the sum of weighted a a^T over the rows, it adds A to the point's
// block, G A to the one between both and G A G^T to the pose's.
struct Share {
  Matrix3d curvature = Matrix3d::Zero();
  Vector3d descent = Vector3d::Zero();
  double twice_cost = 0;
};

Share share_of(const BundleProblem::Term& term, const CameraPlace& camera, const Vector3d& point,
               bool robust) {
  double errors[3];
  Vector3d rows[3];
  term.reprojection.evaluate(camera, point, errors, rows);
  const Loss loss = loss_of(term, errors, robust);
  Share share;
  share.twice_cost = loss.value;
  for (int row = 0; row < term.reprojection.rows(); ++row) {
    const Vector3d weighted = loss.weight * rows[row];
    share.curvature += weighted * rows[row].transpose();
    share.descent -= weighted * errors[row];
  }
  return share;
}

// [v]x m without the zeros.
Matrix3d cross(const Vector3d& v, const Matrix3d& m) {
  Matrix3d product;
  product.row(0) = v.y() * m.row(2) - v.z() * m.row(1);
  product.row(1) = v.z() * m.row(0) - v.x() * m.row(2);
  product.row(2) = v.x() * m.row(1) - v.y() * m.row(0);
  return product;
}

template <typename Block>
auto damping_of(const Block& curvature, double damping) {
  return (damping * curvature.diagonal().cwiseMax(kLeastCurvature)).eval();
}

template <typename Block>
Block damped(const Block& curvature, double damping) {
  Block block = curvature;
  block.diagonal() += damping_of(curvature, damping);
  return block;
}

template <typename Step, typename Block>
double expected_fall(const Step& step, const Block& block, double damping) {
  return step.dot(damping_of(block.curvature, damping).cwiseProduct(step) + block.descent) / 2;
}

// What the elimination of points relies on: blocks of the upper triangle only, no pose twice.
[[maybe_unused]] bool is_in_order(const std::vector<BundleProblem::Term>& terms) {
  return std::adjacent_find(terms.begin(), terms.end(), [](const auto& a, const auto& b) {
           return std::pair(a.point, a.pose) >= std::pair(b.point, b.pose);
         }) == terms.end();
}

std::vector<int> number_free(const BundleProblem& problem) {
  std::vector<int> free;
  int count = 0;
  for (const auto& pose : problem.poses) free.push_back(pose.fixed ? kFixed : count++);
  return free;
}

std::vector<std::size_t> first_terms(const BundleProblem& problem) {
  std::vector<std::size_t> first(problem.points.size() + 1);
  for (const auto& term : problem.terms) ++first[term.point + 1];
  for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
  return first;
}

PosePairs pairs_of(const BundleProblem& problem, const std::vector<int>& free,
                   const std::vector<std::size_t>& first_term) {
  PosePairs pairs(static_cast<int>(
      std::count_if(free.begin(), free.end(), [](int pose) { return pose != kFixed; })));
  std::vector<int> views;
  for (std::size_t point = 0; point + 1 < first_term.size(); ++point) {
    views.clear();
    for (std::size_t t = first_term[point]; t < first_term[point + 1]; ++t)
      if (const int pose = free[problem.terms[t].pose]; pose != kFixed) views.push_back(pose);
    for (std::size_t k = 0; k < views.size(); ++k)
      for (std::size_t l = k + 1; l < views.size(); ++l) pairs.add(views[k], views[l]);
  }
  return pairs;
}

}  // namespace

SchurSolver::SchurSolver(BundleProblem& problem)
    : problem_(problem),
      free_(number_free(problem)),
      first_term_(first_terms(problem)),
      point_blocks_(problem.points.size()),
      between_(problem.terms.size()),
      system_(pairs_of(problem, free_, first_term_)) {
  assert(is_in_order(problem.terms));
  pose_blocks_.resize(static_cast<std::size_t>(system_.poses()));
}

template <typename F>
void SchurSolver::for_each_free_view(std::size_t point, F&& f) const {
  for (std::size_t t = first_term_[point]; t < first_term_[point + 1]; ++t) {
    const int pose = free_[problem_.terms[t].pose];
    if (pose != kFixed && problem_.terms[t].active) f(pose, between_[t]);
  }
}

void SchurSolver::load() {
  now_ = {};
  for (const auto& pose : problem_.poses) {
    now_.poses.push_back(pose.map_from_camera);
    now_.cameras.emplace_back(pose.map_from_camera);
  }
  for (const auto& point : problem_.points) now_.points.push_back(point.position);
}

void SchurSolver::store() {
  for (std::size_t i = 0; i < now_.poses.size(); ++i)
    problem_.poses[i].map_from_camera = now_.poses[i];
  for (std::size_t i = 0; i < now_.points.size(); ++i) problem_.points[i].position = now_.points[i];
}

double SchurSolver::linearise(bool robust) {
  for (PoseBlock& block : pose_blocks_) {
    block.curvature.setZero();
    block.descent.setZero();
  }
  double twice_cost = 0;
  for (std::size_t i = 0; i < point_blocks_.size(); ++i) twice_cost += linearise_point(i, robust);
  for (PoseBlock& block : pose_blocks_)
    block.curvature.bottomLeftCorner<3, 3>() = block.curvature.topRightCorner<3, 3>().transpose();
  return twice_cost / 2;
}

// Returns twice the cost. Leaves out the lower left corner of the poses' curvature.
double SchurSolver::linearise_point(std::size_t point, bool robust) {
  PointBlock& block = point_blocks_[point];
  block.curvature.setZero();
  block.descent.setZero();
  double twice_cost = 0;
  for (std::size_t t = first_term_[point]; t < first_term_[point + 1]; ++t) {
    const BundleProblem::Term& term = problem_.terms[t];
    if (!term.active) continue;
    const CameraPlace& camera = now_.cameras[term.pose];
    const Share share = share_of(term, camera, now_.points[point], robust);
    twice_cost += share.twice_cost;
    block.curvature += share.curvature;
    block.descent += share.descent;
    const int pose = free_[term.pose];
    if (pose == kFixed) continue;
    const Vector3d arm = now_.points[point] - camera.centre;
    const Matrix3d turned = cross(arm, share.curvature);
    between_[t] << -turned, -share.curvature;
    PoseBlock& pose_block = pose_blocks_[static_cast<std::size_t>(pose)];
    pose_block.curvature.topLeftCorner<3, 3>() += cross(arm, turned.transpose());
    pose_block.curvature.topRightCorner<3, 3>() += turned;
    pose_block.curvature.bottomRightCorner<3, 3>() += share.curvature;
    pose_block.descent.head<3>() -= arm.cross(share.descent);
    pose_block.descent.tail<3>() -= share.descent;
  }
  return twice_cost;
}

double SchurSolver::cost(const State& state, bool robust) const {
  double twice_cost = 0;
  for (const auto& term : problem_.terms) {
    if (!term.active) continue;
    double errors[3];
    term.reprojection.evaluate(state.cameras[term.pose], state.points[term.point], errors, nullptr);
    twice_cost += loss_of(term, errors, robust).value;
  }
  return twice_cost / 2;
}

void SchurSolver::eliminate_points(double damping) {
  system_.set_zero();
  Eigen::VectorXd& right_side = system_.vector();
  for (int pose = 0; pose < system_.poses(); ++pose) {
    const PoseBlock& block = pose_blocks_[static_cast<std::size_t>(pose)];
    system_.block(pose, pose) = damped(block.curvature, damping);
    right_side.segment<6>(6 * pose) = block.descent;
  }
  std::vector<std::pair<int, const Matrix63*>> views;
  for (std::size_t i = 0; i < point_blocks_.size(); ++i) {
    PointBlock& point = point_blocks_[i];
    bool invertible = false;
    damped(point.curvature, damping).computeInverseWithCheck(point.inverse, invertible, 0.0);
    if (!invertible || !point.inverse.allFinite()) point.inverse.setZero();
    views.clear();
    for_each_free_view(
        i, [&](int pose, const Matrix63& between) { views.emplace_back(pose, &between); });
    for (std::size_t k = 0; k < views.size(); ++k) {
      const Matrix63 share = *views[k].second * point.inverse;
      right_side.segment<6>(6 * views[k].first) -= share * point.descent;
      for (std::size_t l = k; l < views.size(); ++l)
        system_.block(views[k].first, views[l].first).noalias() -=
            share.lazyProduct(views[l].second->transpose());
    }
  }
}

bool SchurSolver::find_step(double damping) {
  eliminate_points(damping);
  return system_.solve();
}

double SchurSolver::take_step(double damping) {
  double expected = 0;
  next_ = now_;
  const Eigen::VectorXd& pose_steps = system_.vector();
  for (std::size_t i = 0; i < free_.size(); ++i) {
    if (free_[i] == kFixed) continue;
    const Vector6 step = pose_steps.segment<6>(6 * free_[i]);
    expected += expected_fall(step, pose_blocks_[static_cast<std::size_t>(free_[i])], damping);
    next_.poses[i] = perturbed(now_.poses[i], step);
    next_.cameras[i] = CameraPlace(next_.poses[i]);
  }
  for (std::size_t i = 0; i < point_blocks_.size(); ++i) {
    Vector3d left = point_blocks_[i].descent;
    for_each_free_view(i, [&](int pose, const Matrix63& between) {
      left -= between.transpose() * pose_steps.segment<6>(6 * pose);
    });
    const Vector3d step = point_blocks_[i].inverse * left;
    expected += expected_fall(step, point_blocks_[i], damping);
    next_.points[i] += step;
  }
  return expected;
}

// Damping as in Nielsen 1999, "Damping parameter in Marquardt's method".
RoundSummary SchurSolver::solve(const RoundOptions& options, std::stop_token stop) {
  load();
  RoundSummary summary;
  summary.initial_cost = summary.final_cost = linearise(options.robust);
  summary.message = "all iterations used";
  double damping = kFirstDamping, growth = 2;
  while (summary.iterations < options.max_iterations) {
    if (stop.stop_requested()) {
      summary.message = "asked to stop";
      break;
    }
    ++summary.iterations;
    double fall = -HUGE_VAL, gain = -1;
    if (find_step(damping)) {
      const double expected = take_step(damping);
      fall = summary.final_cost - cost(next_, options.robust);
      gain = expected > 0 ? fall / expected : -1;
    }
    const bool converged = std::abs(fall) <= options.function_tolerance * summary.final_cost;
    const bool better = gain > kLeastGain;
    if (better) {
      std::swap(now_, next_);
      summary.final_cost -= fall;
      damping = std::max(kLeastDamping, damping * std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)));
      growth = 2;
    } else {
      damping *= growth;
      growth *= 2;
    }
    if (converged || damping > kMostDamping) {
      summary.message = converged ? "converged" : "no step lowers the cost";
      break;
    }
    if (better && summary.iterations < options.max_iterations) linearise(options.robust);
  }
  store();
  return summary;
}

}  // namespace cairn
