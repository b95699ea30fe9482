// Similarity transform: rotation, translation and one scale. point_b = scale * R * point_a + t.
//
// A single camera measures in a unit of its own. `Sim3 map_from_camera` says of such a camera both
// where it is in the map and how large its unit is there; what it measured is moved by it as a
// whole. A Rigid3 is a Sim3 of scale 1.
#pragma once

#include <optional>
#include <span>

#include "common/geometry/rigid3.h"

namespace cairn {

struct Sim3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double scale = 1.0;

  Sim3() = default;
  Sim3(const Eigen::Quaterniond& r, const Eigen::Vector3d& t, double s)
      : rotation(r), translation(t), scale(s) {}
  // Implicit: every rigid motion is a similarity.
  Sim3(const Rigid3& rigid) : rotation(rigid.rotation), translation(rigid.translation) {}

  Sim3 inverse() const;
  Eigen::Matrix4d matrix() const;
  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
    return scale * (rotation * point) + translation;
  }
  Sim3 operator*(const Sim3& other) const;
  // Moves a pose given in frame a to frame b: the camera turns and moves, its own unit stays.
  Rigid3 move_pose(const Rigid3& a_from_camera) const;
  // Of b_from_camera: where the camera is, without the unit that it measures in.
  Rigid3 pose() const { return {rotation, translation}; }
  bool is_finite() const;
};

// The same b_from_a where what lies in a and in b is told in units so many times as large.
Sim3 in_units(const Sim3& b_from_a, double unit_a, double unit_b);

// The transform b_from_a with the least sum of squared distances |b_i - (s R a_i + t)|^2
// (Umeyama 1991, "Least-squares estimation of transformation parameters between two point
// patterns"). With `with_scale` false the scale is held at 1. Nothing comes back for fewer than
// three points, points that span no plane, or differing counts.
std::optional<Sim3> align_points(std::span<const Eigen::Vector3d> points_a,
                                 std::span<const Eigen::Vector3d> points_b, bool with_scale);

}  // namespace cairn
