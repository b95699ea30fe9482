#include "common/geometry/sim3.h"

#include <cmath>

#include <Eigen/SVD>

namespace cairn {

Sim3 Sim3::inverse() const {
  const Eigen::Quaterniond r = rotation.conjugate();
  const double s = 1.0 / scale;
  return {r, -s * (r * translation), s};
}

Eigen::Matrix4d Sim3::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = scale * rotation.toRotationMatrix();
  m.topRightCorner<3, 1>() = translation;
  return m;
}

bool Sim3::is_finite() const {
  return pose().is_finite() && std::isfinite(scale);
}

Sim3 in_units(const Sim3& b_from_a, double unit_a, double unit_b) {
  return {b_from_a.rotation, b_from_a.translation / unit_b, b_from_a.scale * unit_a / unit_b};
}

Sim3 Sim3::operator*(const Sim3& other) const {
  return {(rotation * other.rotation).normalized(),
          scale * (rotation * other.translation) + translation, scale * other.scale};
}

Rigid3 Sim3::move_pose(const Rigid3& a_from_camera) const {
  return {(rotation * a_from_camera.rotation).normalized(), *this * a_from_camera.translation};
}

std::optional<Sim3> align_points(std::span<const Eigen::Vector3d> points_a,
                                 std::span<const Eigen::Vector3d> points_b, bool with_scale) {
  const std::size_t n = points_a.size();
  if (n < 3 || points_b.size() != n) return std::nullopt;

  Eigen::Vector3d mean_a = Eigen::Vector3d::Zero(), mean_b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) {
    mean_a += points_a[i];
    mean_b += points_b[i];
  }
  mean_a /= static_cast<double>(n);
  mean_b /= static_cast<double>(n);

  double variance_a = 0;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  // Umeyama eq. 38
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d a = points_a[i] - mean_a;
    variance_a += a.squaredNorm();
    covariance += (points_b[i] - mean_b) * a.transpose();
  }
  variance_a /= static_cast<double>(n);
  covariance /= static_cast<double>(n);

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d d = svd.singularValues();
  // Rank below two: the points lie on a line and the rotation about it is free.
  if (!(d(0) > 0) || d(1) < 1e-9 * d(0)) return std::nullopt;

  Eigen::Vector3d signs(1, 1, 1);
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0) signs(2) = -1;
  const Eigen::Matrix3d r = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  const double scale = with_scale ? d.dot(signs) / variance_a : 1.0;  // eq. 42
  return Sim3(Eigen::Quaterniond(r), mean_b - scale * (r * mean_a), scale);
}

}  // namespace cairn
