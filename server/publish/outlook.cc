#include "server/publish/outlook.h"

#include <algorithm>

#include "common/util/clock.h"

namespace cairn {
namespace {

// How far ahead the motion between two keyframes is drawn out: seconds, and times that motion.
constexpr double kAhead_s = 1, kMostTimes = 3;
constexpr double kMargin = 0.25;   // of the image's size, on each side
constexpr double kSideways = 0.1;  // of the distance
constexpr double kMostTurn = 0.8;  // radians that are drawn out at most

Rigid3 drawn_out(const KeyframeNode& latest, const KeyframeNode& before) {
  const double seconds = to_seconds(latest.keyframe->stamp_ns - before.keyframe->stamp_ns);
  if (!(seconds > 0)) return latest.map_from_camera;
  const Rigid3 motion = before.map_from_camera.inverse() * latest.map_from_camera;
  const double times = std::min(kAhead_s / seconds, kMostTimes);
  Eigen::Vector3d turn = times * so3_log(motion.rotation);
  if (turn.norm() > kMostTurn) turn *= kMostTurn / turn.norm();
  return latest.map_from_camera * Rigid3(so3_exp(turn), times * motion.translation);
}

}  // namespace

Outlook::Outlook(const KeyframeNode& latest, const KeyframeNode* before)
    : camera_(latest.rig().camera) {
  map_from_view_ = {latest.map_from_camera,
                    before ? drawn_out(latest, *before) : latest.map_from_camera};
  for (std::size_t i = 0; i < map_from_view_.size(); ++i)
    view_from_map_[i] = map_from_view_[i].inverse();
}

bool Outlook::is_in_view(const Rigid3& view_from_map, const Eigen::Vector3d& point) const {
  const Eigen::Vector3d in_view = view_from_map * point;
  if (in_view.z() <= 0) return false;
  const Eigen::Vector2d pixel = camera_.project(in_view);
  return pixel.x() >= -kMargin * camera_.width && pixel.x() <= (1 + kMargin) * camera_.width &&
         pixel.y() >= -kMargin * camera_.height && pixel.y() <= (1 + kMargin) * camera_.height;
}

bool Outlook::shows(const Eigen::Vector3d& point) const {
  return is_in_view(view_from_map_[0], point) || is_in_view(view_from_map_[1], point);
}

double Outlook::shift_px(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const {
  const Eigen::Vector3d line = to - centre();
  const double distance = line.norm();
  if (distance == 0) return 0;
  const Eigen::Vector3d moved = to - from;
  const double along = std::abs(moved.dot(line)) / distance;
  const double across = moved.cross(line).norm() / distance;
  return camera_.fx * (across + kSideways * along) / distance;
}

}  // namespace cairn
