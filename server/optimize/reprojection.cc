#include "server/optimize/reprojection.h"

#include <algorithm>
#include <limits>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

// Larger than any error in an image, small enough to square.
constexpr double kUnseenError = 1e4;

}  // namespace

CameraPlace::CameraPlace(const Rigid3& map_from_camera)
    : rotation(map_from_camera.rotation.toRotationMatrix()), centre(map_from_camera.origin()) {}

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

bool Reprojection::evaluate(const CameraPlace& camera, const Eigen::Vector3d& point, double* errors,
                            Eigen::Vector3d* by_point) const {
  const Eigen::Vector3d p = camera.rotation.transpose() * (point - camera.centre);  // in camera
  if (!(p.z() > kMinDepth)) {
    std::fill_n(errors, rows_, kUnseenError);
    if (by_point) std::fill_n(by_point, rows_, Eigen::Vector3d::Zero());
    return false;
  }
  const double inv_z = 1 / p.z();
  const double x = p.x() * inv_z, y = p.y() * inv_z;
  const double disparity = fx_baseline_ * inv_z;
  // Row 2 is u - disparity, or the disparity alone.
  const double sign = coupling_ == 0 ? 1.0 : -1.0;
  const double u = fx_ * x + cx_;
  errors[0] = weight_[0] * (u - measured_[0]);
  errors[1] = weight_[1] * (fy_ * y + cy_ - measured_[1]);
  if (rows_ == 3) errors[2] = weight_[2] * (coupling_ * u + sign * disparity - measured_[2]);
  if (!by_point) return true;

  // By the point in camera, then by the point in map.
  const Eigen::Vector3d du(fx_ * inv_z, 0, -fx_ * x * inv_z);
  const Eigen::Vector3d dv(0, fy_ * inv_z, -fy_ * y * inv_z);
  const Eigen::Vector3d dd(0, 0, -disparity * inv_z);
  by_point[0] = camera.rotation * (weight_[0] * du);
  by_point[1] = camera.rotation * (weight_[1] * dv);
  if (rows_ == 3) by_point[2] = camera.rotation * (weight_[2] * (coupling_ * du + sign * dd));
  return true;
}

double Reprojection::chi2(const CameraPlace& camera, const Eigen::Vector3d& point) const {
  Eigen::Vector3d errors = Eigen::Vector3d::Zero();
  if (!evaluate(camera, point, errors.data(), nullptr))
    return std::numeric_limits<double>::infinity();
  return errors.squaredNorm();
}

}  // namespace cairn
