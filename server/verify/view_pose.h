// The pose of one view from landmarks that it shows: least squares of its own errors only, the
// landmarks held. What consensus has found is made exact with it.
#pragma once

#include <span>
#include <vector>

#include "common/geometry/rigid3.h"
#include "common/model/keyframe.h"

namespace cairn {

// A point of the map and the feature that shows it.
struct PointSight {
  Eigen::Vector3d point_in_map = Eigen::Vector3d::Zero();
  std::uint16_t feature = 0;
};

// Squared error over variance, two degrees of freedom or, where the feature has depth, three;
// infinite behind the camera. `slack`: as many times wider than the measurement's own the standard
// deviations are, for the point is uncertain too.
double sight_chi2(const Keyframe& view, const Rigid3& camera_from_map, const PointSight& sight,
                  double slack);
// By the 99 % quantile of that.
bool agrees(const Keyframe& view, const Rigid3& camera_from_map, const PointSight& sight,
            double slack);

// Gauss-Newton with Huber weights, damped (Levenberg 1944), those that disagree left out and taken
// back between rounds. `camera_from_map` is where it starts and where it ends. Returns which sights
// agree in the end; none, and the pose as it was, for fewer than four. Deterministic.
std::vector<bool> refine_view_pose(const Keyframe& view, std::span<const PointSight> sights,
                                   double slack, Rigid3& camera_from_map);

}  // namespace cairn
