// A run's trajectory on disk: one file, or one for each part of the map where a client that was
// lost has begun a new part and nothing has joined it with the others.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/model/trajectory.h"
#include "common/util/status.h"

namespace cairn {

struct TrajectoryFile {
  std::string file;
  std::size_t frames = 0;
  std::int64_t first_ns = 0, last_ns = 0;  // stamps
};

// OUT.tum, OUT.part2.tum, OUT.part3.tum, ... for `number` 1, 2, 3, ...
std::string trajectory_file(const std::string& path, std::size_t number);

// Writes TUM format, each part in a frame of its own; without any pose an empty file. Files of
// later parts that an earlier run has left under these names are removed: they belong to that run.
// kUnavailable: a file can't be written.
Result<std::vector<TrajectoryFile>> write_trajectories(const std::string& path,
                                                       const std::vector<Trajectory>& parts);

}  // namespace cairn
