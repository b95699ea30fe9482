// Makes rectified pairs of raw ones: no distortion, equal rows, one focal length.
//
// Bouguet's method as in OpenCV's stereoRectify (both cameras turn half the way each), for pinhole
// and fisheye lenses; see Hartley and Zisserman, "Multiple View Geometry", section 11.12, for the
// idea. The images are cropped so that every pixel is seen.
#pragma once

#include <opencv2/core/mat.hpp>

#include "common/config/camera_config.h"
#include "common/util/status.h"

namespace cairn {

// Immutable; safe to use from several threads.
class Rectifier {
 public:
  // `raw.right` must be set. Error when the two cameras differ in lens model or size, or stand so
  // that no common view is left.
  static Result<Rectifier> make(const CameraConfig& raw);

  // The camera of the rectified pair: of the left image's size, no distortion, baseline set. Its
  // frame is the raw left camera's, turned.
  const CameraConfig& camera() const { return camera_; }

  cv::Mat left(const cv::Mat& raw) const;
  cv::Mat right(const cv::Mat& raw) const;

 private:
  CameraConfig camera_;
  cv::Mat left_map_, left_fraction_, right_map_, right_fraction_;
};

}  // namespace cairn
