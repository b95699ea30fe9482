// Undistortion of features by table: Newton iterations for a thousand features a frame would cost
// as much as describing them.
#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/camera.h"

namespace cairn {

// Camera::undistort on a grid of pixels, interpolated bilinearly between them; exact where a
// neighbour has no value. Off by less than 0.01 px with ordinary lenses. Immutable; safe to use
// from several threads.
class UndistortMap {
 public:
  explicit UndistortMap(const Camera& camera);

  // Nothing where the camera's undistort() has nothing, or outside the image.
  std::optional<Eigen::Vector2f> undistort(float x, float y) const;

 private:
  Camera camera_;
  bool distorts_ = false;
  int columns_ = 0, rows_ = 0;
  std::vector<Eigen::Vector2f> nodes_;  // row by row; NaN where there is no value
};

}  // namespace cairn
