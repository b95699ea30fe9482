#include "client/tracking/trajectory.h"

namespace cairn {

void FrameTrajectory::add(std::int64_t stamp_ns, KeyframeId reference,
                          const Rigid3& reference_from_camera) {
  frames_.push_back({stamp_ns, reference, reference_from_camera});
}

Trajectory FrameTrajectory::poses(const LocalMap& map) const {
  Trajectory poses;
  poses.reserve(frames_.size());
  for (const Entry& frame : frames_)
    if (const auto map_from_reference = map.pose_of(frame.reference))
      poses.push_back({frame.stamp_ns, *map_from_reference * frame.reference_from_camera});
  return poses;
}

}  // namespace cairn
