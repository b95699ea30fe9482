#include "client/tracking/small_bundle.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Dense>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;

constexpr double kMinDepth = 1e-3;
constexpr double kEnough = 1e-6;  // share of the cost that a step must gain to go on

struct Error {
  Eigen::Vector2d whitened = Eigen::Vector2d::Zero();
  Eigen::Vector3d in_camera = Eigen::Vector3d::Zero();
  bool in_front = false;
};

Error error_of(const PinholeCamera& camera, const SmallBundle& bundle,
               const SmallBundle::Sight& sight) {
  Error e;
  e.in_camera = bundle.camera_from_map[sight.view] * bundle.points[sight.point];
  e.in_front = e.in_camera.z() > kMinDepth;
  if (e.in_front) e.whitened = (camera.project(e.in_camera) - sight.pixel) / sight.sigma;
  return e;
}

double huber_cost(double squared) {
  return squared <= kChi2TwoDof ? squared : 2 * std::sqrt(kChi2TwoDof * squared) - kChi2TwoDof;
}
double huber_weight(double squared) {
  return squared <= kChi2TwoDof ? 1.0 : std::sqrt(kChi2TwoDof / squared);
}

double cost_of(const PinholeCamera& camera, const SmallBundle& bundle) {
  double cost = 0;
  for (const auto& sight : bundle.sights) {
    const Error e = error_of(camera, bundle, sight);
    cost += e.in_front ? huber_cost(e.whitened.squaredNorm()) : 100 * kChi2TwoDof;
  }
  return cost;
}

// The normal equations in blocks: a pose's, a point's, and what a sight ties together.
struct System {
  std::vector<Matrix6> by_pose;
  std::vector<Vector6> pose_gradient;
  std::vector<Eigen::Matrix3d> by_point;
  std::vector<Eigen::Vector3d> point_gradient;
  std::vector<Matrix63> mixed;  // one a sight
};

System linearise(const PinholeCamera& camera, const SmallBundle& bundle) {
  System s;
  s.by_pose.assign(bundle.camera_from_map.size(), Matrix6::Zero());
  s.pose_gradient.assign(bundle.camera_from_map.size(), Vector6::Zero());
  s.by_point.assign(bundle.points.size(), Eigen::Matrix3d::Zero());
  s.point_gradient.assign(bundle.points.size(), Eigen::Vector3d::Zero());
  s.mixed.assign(bundle.sights.size(), Matrix63::Zero());
  for (std::size_t i = 0; i < bundle.sights.size(); ++i) {
    const auto& sight = bundle.sights[i];
    const Error e = error_of(camera, bundle, sight);
    if (!e.in_front) continue;
    const Rigid3& pose = bundle.camera_from_map[sight.view];
    const Eigen::Matrix<double, 2, 3> by_camera =
        camera.projection_jacobian(e.in_camera).topRows<2>() / sight.sigma;
    const Eigen::Matrix<double, 2, 3> by_point = by_camera * pose.rotation.toRotationMatrix();
    // See perturbed() in rigid3.h: d(in camera)/d(omega) = -[R p]x.
    Eigen::Matrix<double, 2, 6> by_pose;
    by_pose << -by_camera * skew(e.in_camera - pose.translation), by_camera;
    const double weight = huber_weight(e.whitened.squaredNorm());
    s.by_point[sight.point] += weight * by_point.transpose() * by_point;
    s.point_gradient[sight.point] += weight * by_point.transpose() * e.whitened;
    if (sight.view == 0) continue;  // held
    s.by_pose[sight.view] += weight * by_pose.transpose() * by_pose;
    s.pose_gradient[sight.view] += weight * by_pose.transpose() * e.whitened;
    s.mixed[i] = weight * by_pose.transpose() * by_point;
  }
  return s;
}

// The system of the poses alone, the points eliminated; damped by `lambda`.
struct Reduced {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
  std::vector<Eigen::Matrix3d> inverse;  // of each point's block
};

// Of a sight's view in the reduced system.
Eigen::Index row(std::uint32_t view) {
  return 6 * (static_cast<Eigen::Index>(view) - 1);
}

Reduced eliminate_points(const SmallBundle& bundle, const System& s, double lambda) {
  const auto views = static_cast<std::uint32_t>(bundle.camera_from_map.size());
  Reduced r{Eigen::MatrixXd::Zero(row(views), row(views)), Eigen::VectorXd::Zero(row(views)),
            std::vector<Eigen::Matrix3d>(bundle.points.size(), Eigen::Matrix3d::Zero())};
  for (std::uint32_t view = 1; view < views; ++view) {
    Matrix6 damped = s.by_pose[view];
    damped.diagonal() *= 1 + lambda;
    damped.diagonal().array() += 1e-9;
    r.matrix.block<6, 6>(row(view), row(view)) = damped;
    r.right.segment<6>(row(view)) = -s.pose_gradient[view];
  }
  for (std::size_t first = 0, end = 0; first < bundle.sights.size(); first = end) {
    const std::uint32_t p = bundle.sights[first].point;
    while (end < bundle.sights.size() && bundle.sights[end].point == p) ++end;
    Eigen::Matrix3d damped = s.by_point[p];
    damped.diagonal() *= 1 + lambda;
    damped.diagonal().array() += 1e-9;
    r.inverse[p] = damped.inverse();
    for (std::size_t i = first; i < end; ++i) {
      const std::uint32_t view = bundle.sights[i].view;
      if (view == 0) continue;
      const Matrix63 carried = s.mixed[i] * r.inverse[p];
      r.right.segment<6>(row(view)) += carried * s.point_gradient[p];
      for (std::size_t j = first; j < end; ++j)
        if (bundle.sights[j].view != 0)
          r.matrix.block<6, 6>(row(view), row(bundle.sights[j].view)) -=
              carried * s.mixed[j].transpose();
    }
  }
  return r;
}

// One step of Levenberg-Marquardt from `bundle`.
SmallBundle stepped(const SmallBundle& bundle, const System& s, double lambda) {
  const Reduced reduced = eliminate_points(bundle, s, lambda);
  const Eigen::VectorXd step = reduced.matrix.ldlt().solve(reduced.right);

  SmallBundle next = bundle;
  std::vector<Eigen::Vector3d> point_right(bundle.points.size());
  for (std::size_t p = 0; p < bundle.points.size(); ++p) point_right[p] = -s.point_gradient[p];
  for (std::size_t i = 0; i < bundle.sights.size(); ++i)
    if (bundle.sights[i].view != 0)
      point_right[bundle.sights[i].point] -=
          s.mixed[i].transpose() * step.segment<6>(row(bundle.sights[i].view));
  for (std::uint32_t view = 1; view < next.camera_from_map.size(); ++view)
    next.camera_from_map[view] = perturbed(next.camera_from_map[view], step.segment<6>(row(view)));
  // A point that is too far for its depth to be told must not cost everything else the step.
  for (std::size_t p = 0; p < next.points.size(); ++p) {
    const Eigen::Vector3d moved = bundle.points[p] + reduced.inverse[p] * point_right[p];
    if ((next.camera_from_map[0] * moved).z() > kMinDepth) next.points[p] = moved;
  }
  return next;
}

}  // namespace

double solve_small_bundle(const PinholeCamera& camera, SmallBundle& bundle, int max_iterations) {
  double cost = cost_of(camera, bundle), lambda = 1e-4;
  if (bundle.sights.empty() || bundle.camera_from_map.size() < 2) return cost;
  System system = linearise(camera, bundle);
  for (int i = 0; i < max_iterations && lambda < 1e6; ++i) {
    SmallBundle next = stepped(bundle, system, lambda);
    const double next_cost = cost_of(camera, next);
    if (!(next_cost < cost)) {  // or not a number
      lambda *= 10;
      continue;
    }
    const bool done = cost - next_cost < kEnough * cost;
    bundle = std::move(next);
    cost = next_cost;
    if (done) break;
    lambda = std::max(lambda * 0.1, 1e-9);
    system = linearise(camera, bundle);
  }
  return cost;
}

double sight_chi2(const PinholeCamera& camera, const SmallBundle& bundle,
                  const SmallBundle::Sight& sight) {
  const Error e = error_of(camera, bundle, sight);
  return e.in_front ? e.whitened.squaredNorm() : std::numeric_limits<double>::infinity();
}

}  // namespace cairn
