// The keys `sensor` and `camera` of a client's configuration, as a CameraConfig.
#pragma once

#include <optional>

#include "common/config/camera_config.h"
#include "common/config/yaml_reader.h"
#include "common/util/status.h"

namespace cairn {

// Reads the top-level keys `sensor` (default rgbd) and `camera`:
//
//   camera:
//     model: pinhole | fisheye      default pinhole
//     resolution: [width, height]   pixels, 16..16384
//     intrinsics: [fx, fy, cx, cy]  pixels
//     distortion: [...]             pinhole k1 k2 p1 p2 [k3]; fisheye k1 k2 k3 k4; [] or absent:
//     none rate_hz: 30                   0.1..1000 depth_scale: 5000             depth image units
//     per metre baseline_m: 0.11              stereo that is rectified: metres, 0.001..10 right:
//     stereo that is not: model, resolution, intrinsics, distortion and
//       left_from_right: [16]       the 4x4 matrix, row by row, metres
//
// Fails with the document's first error, which stays in `root` too (Section::status). Unused keys
// are the caller's to ask for, with root.finish().
Result<CameraConfig> read_camera_config(Section& root);

// `sensor` alone, for sources that bring their own calibration. Nothing when the key is absent.
std::optional<Sensor> read_sensor(Section& root);

}  // namespace cairn
