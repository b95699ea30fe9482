#include "common/geometry/rigid3.h"

#include <algorithm>
#include <cmath>

#include <Eigen/SVD>

namespace cairn {

Eigen::Quaterniond so3_exp(const Eigen::Vector3d& omega) {
  const double angle = omega.norm();
  // Below 1e-8 rad sin(a/2)/a differs from 1/2 by less than a double can tell.
  const double scale = angle < 1e-8 ? 0.5 : std::sin(0.5 * angle) / angle;
  Eigen::Quaterniond q(std::cos(0.5 * angle), scale * omega.x(), scale * omega.y(),
                       scale * omega.z());
  return q.normalized();
}

Eigen::Vector3d so3_log(const Eigen::Quaterniond& rotation) {
  // q and -q are one rotation; the one with w >= 0 has the angle in [0, pi].
  const double sign = rotation.w() < 0 ? -1.0 : 1.0;
  const Eigen::Vector3d v = sign * rotation.vec();
  const double sin_half = v.norm();
  if (sin_half < 1e-12) return 2.0 * v;
  return 2.0 * std::atan2(sin_half, sign * rotation.w()) / sin_half * v;
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Rigid3 Rigid3::from_matrix(const Eigen::Matrix4d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m.topLeftCorner<3, 3>(),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double det = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  const Eigen::Vector3d signs(1, 1, det < 0 ? -1 : 1);
  const Eigen::Matrix3d r = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  return {Eigen::Quaterniond(r), m.topRightCorner<3, 1>()};
}

Rigid3 Rigid3::inverse() const {
  const Eigen::Quaterniond r = rotation.conjugate();
  return {r, -(r * translation)};
}

Eigen::Matrix4d Rigid3::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  m.topRightCorner<3, 1>() = translation;
  return m;
}

Rigid3 Rigid3::operator*(const Rigid3& other) const {
  return {(rotation * other.rotation).normalized(), rotation * other.translation + translation};
}

bool Rigid3::is_finite() const {
  return rotation.coeffs().allFinite() && translation.allFinite();
}

Rigid3 perturbed(const Rigid3& b_from_a, const Eigen::Matrix<double, 6, 1>& delta) {
  return {(so3_exp(delta.head<3>()) * b_from_a.rotation).normalized(),
          b_from_a.translation + delta.tail<3>()};
}

double rotation_angle(const Rigid3& b_from_a) {
  return so3_log(b_from_a.rotation).norm();
}

Rigid3 interpolate(const Rigid3& first, const Rigid3& second, double fraction) {
  return {first.rotation.slerp(fraction, second.rotation),
          (1.0 - fraction) * first.translation + fraction * second.translation};
}

}  // namespace cairn
