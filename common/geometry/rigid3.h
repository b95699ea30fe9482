// Rigid motion in three dimensions.
//
// Transforms are named as a check: `Rigid3 b_from_a` takes points in frame a to frame b, so that
// `c_from_b * b_from_a` and `b_from_a * point_in_a` read without thought. Metres and radians.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

// The rotation of angle |omega| about omega (exponential map of SO(3)).
Eigen::Quaterniond so3_exp(const Eigen::Vector3d& omega);
// Rotation vector of a unit quaternion; the angle lies in [0, pi].
Eigen::Vector3d so3_log(const Eigen::Quaterniond& rotation);
// The matrix [v]x with [v]x * w = v.cross(w).
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3() = default;
  Rigid3(const Eigen::Quaterniond& r, const Eigen::Vector3d& t) : rotation(r), translation(t) {}
  // The upper 3x4 part of `m`; the rotation block is projected onto SO(3).
  static Rigid3 from_matrix(const Eigen::Matrix4d& m);

  Rigid3 inverse() const;
  Eigen::Matrix4d matrix() const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return rotation * point + translation;
  }
  // The result's quaternion is normalised, so that long chains stay rotations.
  Rigid3 operator*(const Rigid3& other) const;

  // Where the origin of frame a lies in frame b: the camera's position for map_from_camera.
  const Eigen::Vector3d& origin() const { return translation; }
  bool is_finite() const;
};

// Left perturbation with a twist (omega, v): exp(omega) turns, v moves. Not the SE(3) exponential
// but the product map SO(3) x R^3, which optimisers prefer: b_from_a' = (exp(omega) R, t + v).
Rigid3 perturbed(const Rigid3& b_from_a, const Eigen::Matrix<double, 6, 1>& delta);

// Angle in radians and distance in metres between two transforms of the same frames.
double rotation_angle(const Rigid3& b_from_a);
Rigid3 interpolate(const Rigid3& first, const Rigid3& second, double fraction);

}  // namespace cairn
