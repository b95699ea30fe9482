// A keyframe as the client measured it. Immutable once made and shared between whoever needs it;
// what changes (its pose in the map, which landmarks it sees) is kept apart, in server/map.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/sim3.h"
#include "common/model/features.h"
#include "common/model/ids.h"

namespace cairn {

enum class Sensor : std::uint8_t { kRgbd = 0, kStereo = 1, kMono = 2 };

// What all keyframes of one client run have in common.
struct Rig {
  Sensor sensor = Sensor::kRgbd;
  PinholeCamera camera;
  ScalePyramid pyramid;
  // Depth beyond this (metres) is too uncertain to make a landmark from a single view.
  double max_depth = 0;

  bool operator==(const Rig&) const = default;
};

// Feature `feature` of the keyframe shows landmark `landmark`.
struct LandmarkMatch {
  std::uint16_t feature = 0;
  LandmarkId landmark;

  bool operator==(const LandmarkMatch&) const = default;
};

struct Keyframe {
  KeyframeId id;
  std::int64_t stamp_ns = 0;
  std::shared_ptr<const Rig> rig;
  Features features;

  // Where it is, and in which unit: its own is that of the map as its client had it when it made
  // the keyframe. A camera without depth has a map of any scale, and a loop or a merge may change
  // that later, when keyframes are still on their way. So both transforms tell how large the own
  // unit is in the other's: in odom's, which stays the same all along the run, and in the
  // reference's own, which does not change either. Scale 1 for sensors with depth.
  Sim3 odom_from_camera;  // the client's own, never corrected
  // The keyframe that this one was tracked against, and the pose relative to it. For the first
  // keyframe of a map `reference` is not valid and `reference_from_camera` is the identity.
  KeyframeId reference;
  Sim3 reference_from_camera;

  // How many times less precisely than usual features lie where they should, see
  // measurement_noise.h: more than 1 for an image blurred by motion, less for a sharp one in a
  // map that fits.
  float noise = 1;

  // At most one match a feature, features ascending. A match whose landmark names this very
  // keyframe and feature (LandmarkId::from_feature) makes that landmark from the feature's depth.
  std::vector<LandmarkMatch> matches;
};

using KeyframePtr = std::shared_ptr<const Keyframe>;

}  // namespace cairn
