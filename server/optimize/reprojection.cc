#include "server/optimize/reprojection.h"

#include <algorithm>
#include <limits>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

// Larger than any error in an image, small enough to square.
constexpr double kUnseenError = 1e4;

using ConstVector3 = Eigen::Map<const Eigen::Vector3d>;

Eigen::Map<Eigen::Vector3d> vector3(double* numbers) {
  return Eigen::Map<Eigen::Vector3d>(numbers);
}

bool give_up(int rows, double* errors, double* pose_jacobian, double* point_jacobian) {
  std::fill_n(errors, rows, kUnseenError);
  if (pose_jacobian) std::fill_n(pose_jacobian, 7 * rows, 0.0);
  if (point_jacobian) std::fill_n(point_jacobian, 3 * rows, 0.0);
  return false;
}

}  // namespace

PoseState to_state(const Rigid3& pose) {
  const auto& q = pose.rotation;
  const auto& t = pose.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

Rigid3 to_rigid(const PoseState& s) {
  return {Eigen::Quaterniond(s[3], s[0], s[1], s[2]).normalized(),
          Eigen::Vector3d(s[4], s[5], s[6])};
}

Reprojection::Reprojection(const Keyframe& keyframe, const Feature& feature)
    : rows_(feature.has_depth() && keyframe.rig->camera.baseline > 0 ? 3 : 2),
      coupling_(keyframe.rig->sensor == Sensor::kStereo ? 1.0 : 0.0),
      fx_(keyframe.rig->camera.fx),
      fy_(keyframe.rig->camera.fy),
      cx_(keyframe.rig->camera.cx),
      cy_(keyframe.rig->camera.cy),
      fx_baseline_(keyframe.rig->camera.fx * keyframe.rig->camera.baseline) {
  const MeasurementSigma sigma = measurement_sigma(keyframe, feature);
  measured_ = {feature.x, feature.y, coupling_ * feature.x - feature.disparity};
  if (coupling_ == 0) measured_.z() = feature.disparity;
  weight_ = {1 / sigma.pixel, 1 / sigma.pixel, 1 / sigma.disparity};
}

bool Reprojection::evaluate(const double* pose, const double* point, double* errors,
                            double* pose_jacobian, double* point_jacobian) const {
  const Eigen::Matrix3d map_from_camera =
      Eigen::Map<const Eigen::Quaterniond>(pose).toRotationMatrix();
  const Eigen::Vector3d offset = ConstVector3(point) - ConstVector3(pose + 4);  // in map
  const Eigen::Vector3d p = map_from_camera.transpose() * offset;               // in camera
  if (!(p.z() > kMinDepth)) return give_up(rows_, errors, pose_jacobian, point_jacobian);

  const double inv_z = 1 / p.z();
  const double x = p.x() * inv_z, y = p.y() * inv_z;
  const double disparity = fx_baseline_ * inv_z;
  // Row 2 is u - disparity, or the disparity alone.
  const double sign = coupling_ == 0 ? 1.0 : -1.0;
  const double u = fx_ * x + cx_;
  errors[0] = weight_[0] * (u - measured_[0]);
  errors[1] = weight_[1] * (fy_ * y + cy_ - measured_[1]);
  if (rows_ == 3) errors[2] = weight_[2] * (coupling_ * u + sign * disparity - measured_[2]);
  if (!pose_jacobian && !point_jacobian) return true;

  // d(error)/d(point in camera), then d(error)/d(point in map) = that * R^T, row by row.
  const Eigen::Vector3d du(fx_ * inv_z, 0, -fx_ * x * inv_z);
  const Eigen::Vector3d dv(0, fy_ * inv_z, -fy_ * y * inv_z);
  const Eigen::Vector3d dd(0, 0, -disparity * inv_z);
  const Eigen::Vector3d in_camera[3] = {weight_[0] * du, weight_[1] * dv,
                                        weight_[2] * (coupling_ * du + sign * dd)};
  for (int row = 0; row < rows_; ++row) {
    const Eigen::Vector3d by_point = map_from_camera * in_camera[row];
    if (point_jacobian) vector3(point_jacobian + 3 * row) = by_point;
    if (!pose_jacobian) continue;
    // The point in camera is R^T exp(-omega) (X - t - v) ~ R^T ((X - t) + [X - t]x omega - v), and
    // a^T [w]x = (a x w)^T.
    double* row_by_pose = pose_jacobian + 7 * row;
    vector3(row_by_pose) = by_point.cross(offset);
    vector3(row_by_pose + 3) = -by_point;
    row_by_pose[6] = 0;
  }
  return true;
}

double Reprojection::chi2(const double* pose, const double* point) const {
  Eigen::Vector3d errors = Eigen::Vector3d::Zero();
  if (!evaluate(pose, point, errors.data(), nullptr, nullptr))
    return std::numeric_limits<double>::infinity();
  return errors.squaredNorm();
}

}  // namespace cairn
