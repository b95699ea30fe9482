// Bundle adjustment of the few views that a monocular map starts from. The client has no Ceres; a
// handful of poses and some hundred points need none.
//
// Levenberg-Marquardt, where each step eliminates the points first (Schur complement; Triggs et al.
// 2000, "Bundle adjustment: a modern synthesis"), which leaves a system of the size of the poses.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"

namespace cairn {

struct SmallBundle {
  struct Sight {
    std::uint32_t view = 0, point = 0;
    Eigen::Vector2d pixel;  // in the ideal camera
    double sigma = 1;       // its standard deviation, pixels
  };

  std::vector<Rigid3> camera_from_map;  // of the views; the first one is held
  std::vector<Eigen::Vector3d> points;  // in map
  std::vector<Sight> sights;            // ascending by point
};

// Lowers the sum of Huber's cost of the sights' errors in place; the width of Huber's kernel is the
// 95 % bound. Returns that sum. Images alone leave the scale open: it stays near where it was.
double solve_small_bundle(const PinholeCamera& camera, SmallBundle& bundle, int max_iterations);

// Squared error of a sight in standard deviations; infinite behind the camera.
double sight_chi2(const PinholeCamera& camera, const SmallBundle& bundle,
                  const SmallBundle::Sight& sight);

}  // namespace cairn
