// A point from the features of two images whose poses are known.
#pragma once

#include <optional>

#include "common/model/keyframe.h"

namespace cairn {

// An image as triangulation sees it, on the client's side or the server's. Refers to what it names.
struct View {
  const Rig* rig;
  const Features* features;
  Rigid3 camera_from_map;
  float noise = 1;  // Keyframe::noise

  static View of(const Keyframe& keyframe, const Rigid3& map_from_camera) {
    return {keyframe.rig.get(), &keyframe.features, map_from_camera.inverse(), keyframe.noise};
  }
  const Feature& feature(std::size_t f) const { return features->points[f]; }
  Eigen::Vector3d origin() const { return camera_from_map.inverse().origin(); }  // in map
};

struct TwoViewPoint {
  Eigen::Vector3d position;  // in map
  // Standard deviation of the distance to the nearer camera over that distance.
  double relative_sigma;
};

// The point that explains both pixels, and both disparities where there are some, with the least
// sum of squared errors, each over its variance (octave, noise): linear equations, reweighted by
// depth (as in Hartley and Sturm 1997, "Triangulation", section 5.2, with a row for the disparity).
// Parallax and depth measurement thus count by how much they tell. Nothing where they don't
// determine a point in front of both.
std::optional<TwoViewPoint> triangulate_two_views(const View& a, const Feature& in_a, const View& b,
                                                  const Feature& in_b);

// Squared error of a point's projection over its variance: 2 degrees of freedom for features
// without depth and 3 for those with it; infinite behind the camera.
double reprojection_chi2(const View& view, const Feature& feature,
                         const Eigen::Vector3d& point_in_map);

}  // namespace cairn
