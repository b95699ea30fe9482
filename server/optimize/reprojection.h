// One observation as an error term: where a landmark should show in a keyframe's image, and where
// its feature was found. Free of any solver, so that it can be tested and reused on its own.
//
// State: a pose `map_from_camera` and a landmark's position in map (metres). The pose is the one
// that the map stores: its translation is the camera's centre, so the left perturbation of
// rigid3.h, (exp(omega) R, t + v), turns the camera about its own centre. Rotation and translation
// stay well apart however far from the map's origin the camera is.
//
// Error, predicted - measured, divided by its standard deviation:
//   row 0, 1   the pixel (u, v)
//   row 2      only for features with depth. Stereo: the column in the right image, u - disparity,
//              which is what a row search measures. RGB-D: the disparity itself, which the depth
//              sensor measures apart from the image.
#pragma once

#include <Eigen/Core>

#include "common/geometry/rigid3.h"
#include "common/model/keyframe.h"

namespace cairn {

// Where a camera stands, ready for many observations.
struct CameraPlace {
  explicit CameraPlace(const Rigid3& map_from_camera);

  Eigen::Matrix3d rotation;  // map from camera
  Eigen::Vector3d centre;    // in map
};

class Reprojection {
 public:
  // 95 % quantiles of chi-squared with two and three degrees of freedom.
  static constexpr double kChi2Pixel = 5.991;
  static constexpr double kChi2Depth = 7.815;
  // Metres. Nearer points, and those behind the camera, can't be seen.
  static constexpr double kMinDepth = 1e-3;

  Reprojection(const Keyframe& keyframe, const Feature& feature);

  bool has_depth() const { return rows_ == 3; }
  int rows() const { return rows_; }
  // Errors above this squared norm are taken for wrong matches.
  double chi2_limit() const { return has_depth() ? kChi2Depth : kChi2Pixel; }

  // Writes rows() errors and, unless `by_point` is null, the derivatives of each by the point.
  // Those by the pose follow from them: for a derivative a by the point X, and the camera's centre
  // t, the left perturbation (omega, v) has (a x (X - t), -a). False, with errors so large that
  // a step there hardly pays, and zero derivatives, when the point is not in front of the camera.
  bool evaluate(const CameraPlace& camera, const Eigen::Vector3d& point, double* errors,
                Eigen::Vector3d* by_point) const;
  // Squared norm of the errors; infinity when the point is not in front of the camera.
  double chi2(const CameraPlace& camera, const Eigen::Vector3d& point) const;

 private:
  int rows_;
  double coupling_;  // share of u in row 2: 1 for the right image's column, 0 for disparity
  double fx_, fy_, cx_, cy_, fx_baseline_;
  Eigen::Vector3d measured_;
  Eigen::Vector3d weight_;  // 1 / standard deviation
};

}  // namespace cairn
