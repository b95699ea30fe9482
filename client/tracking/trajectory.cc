#include "client/tracking/trajectory.h"

#include <map>

namespace cairn {

void FrameTrajectory::add(std::int64_t stamp_ns, KeyframeId reference,
                          const Rigid3& reference_from_camera) {
  if (!every_frame_ && !references_.insert(reference).second) return;
  frames_.push_back({stamp_ns, reference, reference_from_camera});
}

Trajectory FrameTrajectory::poses(const LocalMap& map) const {
  Trajectory poses;
  poses.reserve(frames_.size());
  for (const Entry& frame : frames_)
    if (const auto map_from_reference = map.scaled_pose_of(frame.reference))
      poses.push_back({frame.stamp_ns, map_from_reference->move_pose(frame.reference_from_camera)});
  return poses;
}

std::vector<Trajectory> FrameTrajectory::poses_by_part(const LocalMap& map) const {
  const std::vector<std::uint32_t> parts = map.parts();
  std::map<std::uint32_t, std::size_t> place;  // of a part among the trajectories
  std::vector<Trajectory> trajectories;
  for (const Entry& frame : frames_) {
    const auto map_from_reference = map.scaled_pose_of(frame.reference);
    if (!map_from_reference) continue;
    const auto [at, is_new] = place.emplace(parts[frame.reference.sequence], trajectories.size());
    if (is_new) trajectories.emplace_back();
    trajectories[at->second].push_back(
        {frame.stamp_ns, map_from_reference->move_pose(frame.reference_from_camera)});
  }
  return trajectories;
}

}  // namespace cairn
