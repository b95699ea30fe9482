// Where a camera was at which time, in memory and in text files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/geometry/rigid3.h"
#include "common/util/status.h"

namespace cairn {

// `world` is what the trajectory is told in: a client's map, or the frame of the ground truth.
struct StampedPose {
  std::int64_t stamp_ns = 0;
  Rigid3 world_from_camera;
};

// Ascending in time, no stamp twice.
using Trajectory = std::vector<StampedPose>;

// Reads a trajectory in one of three formats, told apart by what the first line of data looks like:
// - TUM: `seconds tx ty tz qx qy qz qw`, separated by blanks
// - EuRoC ground truth: `nanoseconds,px,py,pz,qw,qx,qy,qz,...`, separated by commas
// - KITTI: 12 numbers, the upper 3x4 of world_from_camera row by row; the stamps come from
//   `times.txt` in the same folder
// Lines that are empty or start with # are skipped; Windows line ends are accepted. Quaternions are
// normalised. Poses out of order are sorted; of those with the same stamp the first counts.
// Fails, naming file and line, on anything else, and on files without a pose.
Result<Trajectory> read_trajectory(const std::string& path);

// Writes TUM format: stamps to the nanosecond, seven digits or more of everything else.
// kUnavailable: the file can't be written.
Status write_trajectory(const std::string& path, const Trajectory& trajectory);

// One line of TUM format, without the line end.
std::string tum_line(const StampedPose& pose);

}  // namespace cairn
