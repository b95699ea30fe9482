// The poses of all tracked frames, kept relative to their reference keyframes, so that what is
// written in the end is what the server has made of it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/tracking/local_map.h"
#include "common/util/status.h"

namespace cairn {

struct StampedPose {
  std::int64_t stamp_ns = 0;
  Rigid3 map_from_camera;
};

class FrameTrajectory {
 public:
  // A frame whose pose relative to an own keyframe is known. Stamps ascend.
  void add(std::int64_t stamp_ns, KeyframeId reference, const Rigid3& reference_from_camera);
  std::size_t size() const { return frames_.size(); }
  // Every frame's pose by the keyframe poses that the map holds now.
  std::vector<StampedPose> poses(const LocalMap& map) const;

 private:
  struct Entry {
    std::int64_t stamp_ns;
    KeyframeId reference;
    Rigid3 reference_from_camera;
  };
  std::vector<Entry> frames_;
};

// Writes `stamp tx ty tz qx qy qz qw` lines (TUM RGB-D format; seconds, metres).
Status write_tum(const std::string& path, const std::vector<StampedPose>& poses);

}  // namespace cairn
