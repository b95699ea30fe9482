#include "common/geometry/camera.h"

#include <algorithm>
#include <cmath>

#include <Eigen/LU>

namespace cairn {
namespace {

using Vector2 = Eigen::Vector2d;
using Matrix2 = Eigen::Matrix2d;

struct Distorted {
  Vector2 point;
  Matrix2 jacobian;  // d(distorted) / d(normalised)
};

// Brown's radial-tangential model on the normalised plane z = 1.
Distorted distort_radtan(const Vector2& p, const std::array<double, 5>& k) {
  const auto [k1, k2, p1, p2, k3] = k;
  const double x = p.x(), y = p.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double d_radial = k1 + r2 * (2 * k2 + r2 * 3 * k3);  // d(radial) / d(r2)
  Distorted out;
  out.point = {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
               y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  out.jacobian(0, 0) = radial + 2 * x * x * d_radial + 2 * p1 * y + 6 * p2 * x;
  out.jacobian(0, 1) = 2 * x * y * d_radial + 2 * p1 * x + 2 * p2 * y;
  out.jacobian(1, 0) = out.jacobian(0, 1);
  out.jacobian(1, 1) = radial + 2 * y * y * d_radial + 6 * p1 * y + 2 * p2 * x;
  return out;
}

// Equidistant polynomial: theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8).
double distort_angle(double theta, const std::array<double, 5>& k) {
  const double t2 = theta * theta;
  return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
}
double distort_angle_derivative(double theta, const std::array<double, 5>& k) {
  const double t2 = theta * theta;
  return 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
}

constexpr int kMaxNewton = 20;
constexpr double kNewtonTolerance = 1e-10;
constexpr double kMaxUndistortAngle = 80.0 * M_PI / 180.0;

}  // namespace

Eigen::Matrix3d PinholeCamera::projection_jacobian(const Eigen::Vector3d& p) const {
  const double iz = 1.0 / p.z(), iz2 = iz * iz;
  Eigen::Matrix3d j;
  j << fx * iz, 0, -fx * p.x() * iz2,  //
      0, fy * iz, -fy * p.y() * iz2,   //
      0, 0, -fx * baseline * iz2;
  return j;
}

bool Camera::has_distortion() const {
  return lens_ == LensModel::kFisheye ||
         std::any_of(distortion_.begin(), distortion_.end(), [](double k) { return k != 0; });
}

std::optional<Vector2> Camera::project(const Eigen::Vector3d& p) const {
  const auto [fx, fy, cx, cy] = intrinsics_;
  if (lens_ == LensModel::kPinhole) {
    if (!(p.z() > 0)) return std::nullopt;
    const Distorted d = distort_radtan(p.head<2>() / p.z(), distortion_);
    // Past the point where the radial polynomial folds back the image is not the lens's.
    if (d.jacobian.determinant() <= 0) return std::nullopt;
    return Vector2(fx * d.point.x() + cx, fy * d.point.y() + cy);
  }
  const double r = p.head<2>().norm();
  const double theta = std::atan2(r, p.z());
  if (!(theta < M_PI) || distort_angle_derivative(theta, distortion_) <= 0) return std::nullopt;
  const double scale = r > 1e-12 ? distort_angle(theta, distortion_) / r : 1.0 / p.z();
  return Vector2(fx * scale * p.x() + cx, fy * scale * p.y() + cy);
}

Eigen::Matrix<double, 2, 3> Camera::projection_jacobian(const Eigen::Vector3d& p) const {
  Eigen::Matrix<double, 2, 3> j = Eigen::Matrix<double, 2, 3>::Zero();
  if (!project(p)) return j;
  const Eigen::DiagonalMatrix<double, 2> focal(intrinsics_[0], intrinsics_[1]);
  if (lens_ == LensModel::kPinhole) {
    const double iz = 1.0 / p.z();
    Eigen::Matrix<double, 2, 3> normalise;
    normalise << iz, 0, -p.x() * iz * iz, 0, iz, -p.y() * iz * iz;
    return focal * distort_radtan(p.head<2>() * iz, distortion_).jacobian * normalise;
  }
  const double r2 = p.head<2>().squaredNorm(), r = std::sqrt(r2);
  if (r < 1e-12) {
    j(0, 0) = intrinsics_[0] / p.z();
    j(1, 1) = intrinsics_[1] / p.z();
    return j;
  }
  const double norm2 = r2 + p.z() * p.z();
  const double theta = std::atan2(r, p.z());
  const double d = distort_angle(theta, distortion_);
  const double dd = distort_angle_derivative(theta, distortion_);
  // q = d(theta) / r * (x, y), with d theta / d(x, y) = z / (r norm2) (x, y), d theta / dz = -r /
  // norm2.
  const Vector2 xy = p.head<2>();
  const double radial = dd * p.z() / (norm2 * r2) - d / (r2 * r);
  Eigen::Matrix<double, 2, 3> dq;
  dq.leftCols<2>() = d / r * Matrix2::Identity() + radial * xy * xy.transpose();
  dq.col(2) = -dd / norm2 * xy;
  return focal * dq;
}

std::optional<Eigen::Vector3d> Camera::unproject(const Vector2& pixel) const {
  const auto [fx, fy, cx, cy] = intrinsics_;
  const Vector2 target((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  if (!target.allFinite()) return std::nullopt;

  if (lens_ == LensModel::kPinhole) {
    Vector2 p = target;
    for (int i = 0; i < kMaxNewton; ++i) {
      const Distorted d = distort_radtan(p, distortion_);
      if (d.jacobian.determinant() <= 0) return std::nullopt;
      const Vector2 error = d.point - target;
      if (error.squaredNorm() < kNewtonTolerance * kNewtonTolerance)
        return Eigen::Vector3d(p.x(), p.y(), 1).normalized();
      p -= d.jacobian.inverse() * error;
    }
    return std::nullopt;
  }

  const double r_d = target.norm();
  if (r_d < 1e-12) return Eigen::Vector3d(0, 0, 1);
  double theta = std::min(r_d, M_PI - 1e-3);
  for (int i = 0; i < kMaxNewton; ++i) {
    const double slope = distort_angle_derivative(theta, distortion_);
    if (slope <= 0) return std::nullopt;
    const double error = distort_angle(theta, distortion_) - r_d;
    if (std::abs(error) < kNewtonTolerance) {
      const Vector2 direction = std::sin(theta) / r_d * target;
      return Eigen::Vector3d(direction.x(), direction.y(), std::cos(theta));
    }
    theta = std::clamp(theta - error / slope, 0.0, M_PI - 1e-6);
  }
  return std::nullopt;
}

std::optional<Vector2> Camera::undistort(const Vector2& pixel) const {
  if (!has_distortion()) return pixel;
  const auto ray = unproject(pixel);
  if (!ray || ray->z() < std::cos(kMaxUndistortAngle)) return std::nullopt;
  return ideal(0).project(*ray);
}

PinholeCamera Camera::ideal(double baseline) const {
  return {intrinsics_[0], intrinsics_[1], intrinsics_[2], intrinsics_[3],
          width_,         height_,        baseline};
}

}  // namespace cairn
