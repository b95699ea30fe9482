#include "client/tracking/pose_solver.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace cairn {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr int kRounds = 4;
constexpr int kRobustRounds = 2;  // the first ones; then outliers are out and least squares is best
constexpr int kMaxIterations = 10;   // a round
constexpr double kMinDepth = 1e-3;   // metres; points nearer or behind can't be seen
constexpr double kConverged = 1e-7;  // radians and metres

struct Residual {
  Eigen::Vector3d whitened =
      Eigen::Vector3d::Zero();  // u, v, disparity; the last is 0 where not measured
  double squared = 0;
  bool in_front = false;
};

Residual residual(const PinholeCamera& camera, const PoseObservation& o,
                  const Eigen::Vector3d& in_camera) {
  Residual r;
  r.in_front = in_camera.z() > kMinDepth;
  if (!r.in_front) return r;
  const Eigen::Vector2d e = camera.project(in_camera) - o.pixel;
  r.whitened << e / o.sigma.pixel,
      o.disparity > 0 ? (camera.disparity(in_camera.z()) - o.disparity) / o.sigma.disparity : 0.0;
  r.squared = r.whitened.squaredNorm();
  return r;
}

double threshold(const PoseObservation& o) {
  return o.disparity > 0 ? kChi2ThreeDof : kChi2TwoDof;
}

// Huber's cost and weight for a squared whitened residual; the kernel's width is the
// usual outlier bound, whatever the slack: the start may be far off.
double huber_cost(double squared, double bound) {
  return squared <= bound ? squared : 2 * std::sqrt(bound * squared) - bound;
}
double huber_weight(double squared, double bound) {
  return squared <= bound ? 1.0 : std::sqrt(bound / squared);
}

struct NormalEquations {
  Matrix6 h = Matrix6::Zero();
  Vector6 g = Vector6::Zero();
  double cost = 0;
};

NormalEquations linearise(const PinholeCamera& camera, const Rigid3& camera_from_map,
                          std::span<const PoseObservation> observations,
                          const std::vector<bool>& use, bool robust) {
  NormalEquations n;
  const Eigen::Matrix3d rotation = camera_from_map.rotation.toRotationMatrix();
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!use[i]) continue;
    const PoseObservation& o = observations[i];
    const Eigen::Vector3d rotated = rotation * o.point_in_map;
    const Eigen::Vector3d in_camera = rotated + camera_from_map.translation;
    const Residual r = residual(camera, o, in_camera);
    if (!r.in_front) {
      n.cost += threshold(o);
      continue;
    }
    const double weight = robust ? huber_weight(r.squared, threshold(o)) : 1.0;
    n.cost += robust ? huber_cost(r.squared, threshold(o)) : r.squared;

    Eigen::Matrix3d by_point = camera.projection_jacobian(in_camera);
    by_point.topRows<2>() /= o.sigma.pixel;
    if (o.disparity > 0)
      by_point.row(2) /= o.sigma.disparity;
    else
      by_point.row(2).setZero();
    // d(in_camera) / d(omega) = -[R p]x, d(in_camera) / d(v) = I: see perturbed() in rigid3.h.
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian.leftCols<3>() = -by_point * skew(rotated);
    jacobian.rightCols<3>() = by_point;
    n.h.noalias() += weight * jacobian.transpose() * jacobian;
    n.g.noalias() += weight * jacobian.transpose() * r.whitened;
  }
  return n;
}

// Levenberg-Marquardt on the observations in `use`.
Rigid3 minimise(const PinholeCamera& camera, Rigid3 camera_from_map,
                std::span<const PoseObservation> observations, const std::vector<bool>& use,
                bool robust) {
  double lambda = 1e-6;
  NormalEquations now = linearise(camera, camera_from_map, observations, use, robust);
  for (int i = 0; i < kMaxIterations; ++i) {
    Matrix6 damped = now.h;
    damped.diagonal() *= 1 + lambda;
    damped.diagonal().array() += 1e-9;
    const Vector6 step = damped.ldlt().solve(-now.g);
    if (!step.allFinite()) break;
    const Rigid3 candidate = perturbed(camera_from_map, step);
    NormalEquations next = linearise(camera, candidate, observations, use, robust);
    if (next.cost <= now.cost) {
      camera_from_map = candidate;
      const bool little_gained = now.cost - next.cost < 1e-6 * now.cost;
      now = next;
      lambda = std::max(lambda * 0.1, 1e-9);
      if (step.norm() < kConverged || little_gained) break;
    } else {
      lambda = std::max(lambda * 10, 1e-4);
      if (lambda > 1e4) break;
    }
  }
  return camera_from_map;
}

double median_squared_distance(const PinholeCamera& camera, const Rigid3& camera_from_map,
                               std::span<const PoseObservation> observations) {
  std::vector<double> squared;
  for (const PoseObservation& o : observations) {
    const Residual r = residual(camera, o, camera_from_map * o.point_in_map);
    const double in_image = r.whitened.head<2>().squaredNorm();
    if (r.in_front && in_image < kGrossSigma * kGrossSigma) squared.push_back(in_image);
  }
  if (squared.empty()) return 0;
  const auto middle = squared.begin() + static_cast<std::ptrdiff_t>(squared.size() / 2);
  std::nth_element(squared.begin(), middle, squared.end());
  return *middle;
}

}  // namespace

PoseSolution solve_pose(const PinholeCamera& camera, const Rigid3& initial_map_from_camera,
                        std::span<const PoseObservation> observations, double slack) {
  PoseSolution solution;
  solution.map_from_camera = initial_map_from_camera;
  solution.is_inlier.assign(observations.size(), false);
  if (observations.size() < 3) return solution;

  std::vector<bool> use(observations.size(), true);
  Rigid3 camera_from_map = initial_map_from_camera.inverse();
  for (int round = 0; round < kRounds; ++round) {
    camera_from_map = minimise(camera, camera_from_map, observations, use, round < kRobustRounds);
    int inliers = 0;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const Residual r =
          residual(camera, observations[i], camera_from_map * observations[i].point_in_map);
      use[i] = r.in_front && r.squared <= slack * slack * threshold(observations[i]);
      inliers += use[i];
    }
    solution.inliers = inliers;
    if (inliers < 3) break;
  }
  solution.median_squared = median_squared_distance(camera, camera_from_map, observations);
  solution.map_from_camera = camera_from_map.inverse();
  solution.is_inlier = std::move(use);
  return solution;
}

}  // namespace cairn
