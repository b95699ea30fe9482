#include "client/tracking/trajectory.h"

#include <fstream>

#include <fmt/format.h>

namespace cairn {

void FrameTrajectory::add(std::int64_t stamp_ns, KeyframeId reference,
                          const Rigid3& reference_from_camera) {
  frames_.push_back({stamp_ns, reference, reference_from_camera});
}

std::vector<StampedPose> FrameTrajectory::poses(const LocalMap& map) const {
  std::vector<StampedPose> poses;
  poses.reserve(frames_.size());
  for (const Entry& frame : frames_)
    if (const auto map_from_reference = map.pose_of(frame.reference))
      poses.push_back({frame.stamp_ns, *map_from_reference * frame.reference_from_camera});
  return poses;
}

Status write_tum(const std::string& path, const std::vector<StampedPose>& poses) {
  std::ofstream out(path);
  for (const StampedPose& p : poses) {
    const Eigen::Vector3d& t = p.map_from_camera.translation;
    const Eigen::Quaterniond& q = p.map_from_camera.rotation;
    // Integer arithmetic keeps all nine digits of the stamp: a double of today's seconds has seven.
    out << fmt::format("{}.{:09} {:.7f} {:.7f} {:.7f} {:.7f} {:.7f} {:.7f} {:.7f}\n",
                       p.stamp_ns / 1'000'000'000, p.stamp_ns % 1'000'000'000, t.x(), t.y(), t.z(),
                       q.x(), q.y(), q.z(), q.w());
  }
  out.close();
  if (!out)
    return {ErrorCode::kUnavailable,
            fmt::format("{}: can't write the trajectory; is the folder there and writable?", path)};
  return {};
}

}  // namespace cairn
