// Undistortion of features by table: Newton iterations for a thousand features a frame would cost
// as much as describing them.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/camera.h"

namespace cairn {

// Camera::undistort on a grid of pixels, interpolated bilinearly between them. Where that would be
// off by more than 0.01 px (at the rim of a fisheye image) or a neighbour has no value, the camera
// itself is asked. Immutable; safe to use from several threads.
class UndistortMap {
 public:
  explicit UndistortMap(const Camera& camera);

  // Nothing where the camera's undistort() has nothing, or outside the image.
  std::optional<Eigen::Vector2f> undistort(float x, float y) const;

 private:
  Eigen::Vector2f& node(int column, int row);
  void drop_curved();

  Camera camera_;
  bool distorts_ = false;
  int columns_ = 0, rows_ = 0;
  std::vector<Eigen::Vector2f> nodes_;  // row by row; NaN where the camera is to be asked
};

}  // namespace cairn
