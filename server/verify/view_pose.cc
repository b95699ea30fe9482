#include "server/verify/view_pose.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// 99 % quantiles of chi-squared with two and three degrees of freedom.
constexpr double kTwoDof = 9.21, kThreeDof = 11.34;
constexpr double kHuber = 2.5;  // standard deviations
constexpr int kRounds = 4, kSteps = 6;
constexpr std::size_t kFewest = 4;
constexpr double kDamping = 1e-6;
constexpr double kSmallStep = 1e-8;  // radians and metres

// Whitened errors of one sight: u, v and, with depth, disparity; and by what the point in the
// camera changes them.
struct Errors {
  int rows = 0;
  Eigen::Vector3d r = Eigen::Vector3d::Zero();
  Eigen::Vector3d in_camera = Eigen::Vector3d::Zero();
  Eigen::Vector3d weight = Eigen::Vector3d::Zero();
};

Errors errors_of(const Keyframe& view, const Rigid3& camera_from_map, const PointSight& sight,
                 double slack) {
  Errors e;
  e.in_camera = camera_from_map * sight.point_in_map;
  if (!(e.in_camera.z() > 0)) return e;
  const PinholeCamera& camera = view.rig->camera;
  const Feature& f = view.features.points[sight.feature];
  const MeasurementSigma sigma = measurement_sigma(view, f);
  const bool depth = f.has_depth() && camera.baseline > 0;
  const Eigen::Vector2d pixel = camera.project(e.in_camera) - f.pixel();
  e.rows = depth ? 3 : 2;
  e.weight =
      Eigen::Vector3d(1 / sigma.pixel, 1 / sigma.pixel, depth ? 1 / sigma.disparity : 0) / slack;
  e.r = {pixel.x(), pixel.y(), depth ? camera.disparity(e.in_camera.z()) - f.disparity : 0};
  e.r = e.r.cwiseProduct(e.weight);
  return e;
}

class Refinement {
 public:
  Refinement(const Keyframe& view, std::span<const PointSight> sights, double slack)
      : view_(view), sights_(sights), slack_(slack), used_(sights.size(), true) {}

  std::vector<bool> run(Rigid3& pose) {
    const Rigid3 before = pose;
    for (int round = 0; round < kRounds; ++round) {
      if (static_cast<std::size_t>(std::count(used_.begin(), used_.end(), true)) < kFewest) {
        pose = before;
        return std::vector<bool>(sights_.size(), false);
      }
      solve(pose);
      for (std::size_t i = 0; i < sights_.size(); ++i)
        used_[i] = agrees(view_, pose, sights_[i], slack_);
    }
    return used_;
  }

 private:
  void solve(Rigid3& pose) const {
    double cost = linearise(pose, nullptr, nullptr);
    for (int step = 0; step < kSteps; ++step) {
      Matrix6 h = Matrix6::Zero();
      Vector6 g = Vector6::Zero();
      linearise(pose, &h, &g);
      h.diagonal() *= 1 + kDamping;
      const Vector6 delta = -h.ldlt().solve(g);
      if (!delta.allFinite()) return;
      const Rigid3 next = perturbed(pose, delta);
      const double next_cost = linearise(next, nullptr, nullptr);
      if (!(next_cost < cost)) return;
      pose = next;
      cost = next_cost;
      if (delta.norm() < kSmallStep) return;
    }
  }

  // The robust cost; and, where wanted, the normal equations. A point that has come behind the
  // camera counts as an error that nothing could make larger.
  double linearise(const Rigid3& pose, Matrix6* h, Vector6* g) const {
    double cost = 0;
    for (std::size_t i = 0; i < sights_.size(); ++i) {
      if (!used_[i]) continue;
      const Errors e = errors_of(view_, pose, sights_[i], slack_);
      if (e.rows == 0) {
        cost += 1e6;
        continue;
      }
      const double norm = e.r.norm();
      const double weight = norm <= kHuber ? 1 : kHuber / norm;
      cost += norm <= kHuber ? 0.5 * norm * norm : kHuber * (norm - 0.5 * kHuber);
      if (!h) continue;
      // Left perturbation: the point moves by -[p - t]x w + v.
      Eigen::Matrix<double, 3, 6> j;
      const Eigen::Matrix3d by_point =
          e.weight.asDiagonal() * view_.rig->camera.projection_jacobian(e.in_camera);
      j << -by_point * skew(e.in_camera - pose.translation), by_point;
      *h += weight * j.transpose() * j;
      *g += weight * j.transpose() * e.r;
    }
    return cost;
  }

  const Keyframe& view_;
  const std::span<const PointSight> sights_;
  const double slack_;
  std::vector<bool> used_;
};

}  // namespace

double sight_chi2(const Keyframe& view, const Rigid3& camera_from_map, const PointSight& sight,
                  double slack) {
  const Errors e = errors_of(view, camera_from_map, sight, slack);
  return e.rows == 0 ? std::numeric_limits<double>::infinity() : e.r.squaredNorm();
}

bool agrees(const Keyframe& view, const Rigid3& camera_from_map, const PointSight& sight,
            double slack) {
  const bool depth =
      view.features.points[sight.feature].has_depth() && view.rig->camera.baseline > 0;
  return sight_chi2(view, camera_from_map, sight, slack) <= (depth ? kThreeDof : kTwoDof);
}

std::vector<bool> refine_view_pose(const Keyframe& view, std::span<const PointSight> sights,
                                   double slack, Rigid3& camera_from_map) {
  return Refinement(view, sights, slack).run(camera_from_map);
}

}  // namespace cairn
