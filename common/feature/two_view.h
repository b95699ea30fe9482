// A point from the features of two keyframes.
#pragma once

#include <optional>

#include "server/map/map.h"

namespace cairn {

// One feature and the keyframe that has it. Refers to both.
struct Ray {
  const KeyframeNode* node;
  const Rigid3* camera_from_map;
  const Feature* feature;
};

struct TwoViewPoint {
  Eigen::Vector3d position;  // in map
  // Standard deviation of the distance to the nearer camera over that distance.
  double relative_sigma;
};

// The point that explains both pixels, and both disparities where there are some, with the least
// sum of squared errors, each over its variance (octave): linear equations, reweighted by depth (as
// in Hartley and Sturm 1997, "Triangulation", section 5.2, with a row for the disparity). Parallax
// and depth measurement thus count by how much they tell. Nothing where they don't determine a
// point in front of both.
std::optional<TwoViewPoint> triangulate_two_views(const Ray& a, const Ray& b);

}  // namespace cairn
