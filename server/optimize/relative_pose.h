// The transform between two cameras, or two groups of cameras with known poses inside each group,
// from points that both know: refinement of what consensus search has found. Used to verify loops.
//
// Group a and group b each have a primary camera, in whose frame the group's points are given. What
// is sought is a_from_b, between the primary cameras' frames.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "common/geometry/sim3.h"
#include "common/model/keyframe.h"

namespace cairn {

// A point of one group and the feature of a camera of the other group that should show it.
struct Sight {
  Sight() = default;
  // `camera_from_primary`: of the observing camera, in its own group. `slack`: how many times wider
  // than the measurement's own the standard deviation is, for the point is uncertain too.
  Sight(const Eigen::Vector3d& point_in_other, const Keyframe& keyframe, const Feature& feature,
        const Rigid3& camera_from_primary, double slack);

  // Squared error over variance, rows() degrees of freedom; infinity behind the camera.
  double chi2(const Sim3& primary_from_other) const;
  int rows() const { return has_depth ? 3 : 2; }

  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  Rigid3 camera_from_primary;
  double fx = 0, fy = 0, cx = 0, cy = 0, fx_baseline = 0;
  double u = 0, v = 0, disparity = 0;
  double pixel_weight = 1, disparity_weight = 1;  // 1 / standard deviation
  bool has_depth = false;
};

// The same point, as each group knows it.
struct SharedPoint {
  Sight in_a;  // group b's point in a camera of group a
  Sight in_b;  // group a's point in a camera of group b
};

struct RelativePoseOptions {
  bool fix_scale = true;
  double huber = 2.5;  // standard deviations
  int max_iterations = 20;
};

// Least squares of the errors in both directions, robust by Huber's loss. Nothing where the solver
// fails or fewer than three points are given. Deterministic.
std::optional<Sim3> refine_relative_pose(const Sim3& a_from_b, std::span<const SharedPoint> points,
                                         const RelativePoseOptions& options);

}  // namespace cairn
