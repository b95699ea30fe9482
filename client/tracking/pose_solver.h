// Pose of one camera from known points: pose-only optimisation as in the ORB-SLAM2 paper (section
// III-C, "motion-only bundle adjustment").
#pragma once

#include <span>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"
#include "common/model/measurement_noise.h"

namespace cairn {

// A point of the map and where the camera sees it.
struct PoseObservation {
  Eigen::Vector3d point_in_map;  // metres
  Eigen::Vector2d pixel;         // in the ideal camera
  double disparity = 0;          // pixels; 0: not measured
  MeasurementSigma sigma;        // pixels
};

inline constexpr double kGrossSigma = 5.5;

struct PoseSolution {
  Rigid3 map_from_camera;
  std::vector<bool> is_inlier;  // one an observation
  int inliers = 0;
  // Median over the observations that are not grossly wrong (within kGrossSigma) of the squared
  // distance in the image, in standard deviations: how precise this view is as a whole.
  double median_squared = 0;
};

// Minimises the Huber-robust reprojection error, starting at `initial_map_from_camera`. Outliers
// are sorted out between rounds by the chi-square test and may come back in a later round; the last
// rounds are plain least squares over the inliers. `slack`: how many times the usual standard
// deviations count in that test. With fewer than three observations nothing is solved: the initial
// pose comes back and no inliers.
PoseSolution solve_pose(const PinholeCamera& camera, const Rigid3& initial_map_from_camera,
                        std::span<const PoseObservation> observations, double slack = 1);

}  // namespace cairn
