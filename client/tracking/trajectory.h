// The poses of tracked frames, kept relative to their reference keyframes, so that what is written
// in the end is what the server has made of it.
#pragma once

#include <cstdint>
#include <unordered_set>
#include <vector>

#include "client/tracking/local_map.h"
#include "common/model/trajectory.h"

namespace cairn {

class FrameTrajectory {
 public:
  // Of all frames, 100 bytes each, or of the first one at each reference keyframe: enough to tell
  // in how many parts of the map the run was.
  explicit FrameTrajectory(bool every_frame = true) : every_frame_(every_frame) {}

  // A frame whose pose relative to an own keyframe is known, in that one's own unit. Stamps ascend.
  void add(std::int64_t stamp_ns, KeyframeId reference, const Rigid3& reference_from_camera);
  std::size_t size() const { return frames_.size(); }
  // The frames' poses by the keyframe poses that the map holds now.
  Trajectory poses(const LocalMap& map) const;
  // The same by parts of the map, which have a frame, and without depth a scale, each of its own.
  // In the order of their first frames; none empty.
  std::vector<Trajectory> poses_by_part(const LocalMap& map) const;

 private:
  struct Entry {
    std::int64_t stamp_ns;
    KeyframeId reference;
    Rigid3 reference_from_camera;
  };
  const bool every_frame_;
  std::vector<Entry> frames_;
  std::unordered_set<KeyframeId> references_;  // unless every frame is kept
};

}  // namespace cairn
