// One image on its way through the tracker: its features and what they were found to show.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/feature/feature_grid.h"
#include "common/model/keyframe.h"
#include "common/model/measurement_noise.h"

namespace cairn {

// What a feature shows: a landmark of the map, or a passing point (landmark not valid) that the
// last frame's depth gave and that only helps to find this frame's pose.
struct FeatureMatch {
  bool matched = false;
  LandmarkId landmark;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map

  bool shows_landmark() const { return matched && landmark.is_valid(); }
};

struct TrackedFrame {
  std::int64_t stamp_ns = 0;
  std::shared_ptr<const Rig> rig;
  Features features;
  FeatureGrid grid;
  std::vector<FeatureMatch> matches;  // one a feature
  Rigid3 map_from_camera;
  double slack = 1;  // of the outlier test, see NoiseLevel
  // How far off the matches lie, see PoseSolution; known once the pose is.
  std::optional<double> median_squared;

  TrackedFrame(std::int64_t stamp, std::shared_ptr<const Rig> the_rig, Features found)
      : stamp_ns(stamp),
        rig(std::move(the_rig)),
        features(std::move(found)),
        grid(features, rig->camera),
        matches(features.size()) {}

  // See Keyframe::noise.
  float noise() const { return median_squared ? keyframe_noise(*median_squared) : 1.0f; }
  // Before another try to place the frame.
  void clear_matches() {
    matches.assign(features.size(), {});
    median_squared.reset();
  }
  // Where feature f lies by its depth, in map. Needs has_depth().
  Eigen::Vector3d point_in_map(std::size_t f) const {
    const Feature& feature = features.points[f];
    return map_from_camera *
           rig->camera.unproject(feature.pixel(), rig->camera.depth(feature.disparity));
  }
  std::vector<LandmarkId> landmarks() const {
    std::vector<LandmarkId> ids;
    for (const FeatureMatch& m : matches)
      if (m.shows_landmark()) ids.push_back(m.landmark);
    return ids;
  }
};

}  // namespace cairn
