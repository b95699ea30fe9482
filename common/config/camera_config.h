// The camera part of a client's configuration (DESIGN: "A client config is complete with two
// keys").
#pragma once

#include <optional>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"
#include "common/model/keyframe.h"

namespace cairn {

// Calibration of what delivers the images, as the user or the data set gives it.
struct CameraConfig {
  Sensor sensor = Sensor::kRgbd;
  Camera camera;  // the only one, or the left one of a pair
  double rate_hz = 30;
  double depth_scale = 5000;  // RGB-D: depth image units per metre
  double baseline_m = 0;      // stereo pairs that are rectified already: distance of the cameras

  // Stereo pairs that are not rectified: the right camera and where it is.
  struct RightCamera {
    Camera camera;
    Rigid3 left_from_right;
  };
  std::optional<RightCamera> right;
};

}  // namespace cairn
