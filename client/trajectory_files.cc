#include "client/trajectory_files.h"

#include <algorithm>
#include <filesystem>

namespace cairn {

namespace fs = std::filesystem;

std::string trajectory_file(const std::string& path, std::size_t number) {
  if (number <= 1) return path;
  const fs::path whole(path);
  const std::string name =
      whole.stem().string() + ".part" + std::to_string(number) + whole.extension().string();
  return (whole.parent_path() / name).string();
}

Result<std::vector<TrajectoryFile>> write_trajectories(const std::string& path,
                                                       const std::vector<Trajectory>& parts) {
  std::vector<TrajectoryFile> written;
  const std::size_t count = std::max<std::size_t>(parts.size(), 1);
  for (std::size_t i = 0; i < count; ++i) {
    const Trajectory part = i < parts.size() ? parts[i] : Trajectory{};
    TrajectoryFile file{.file = trajectory_file(path, i + 1), .frames = part.size()};
    if (!part.empty()) {
      file.first_ns = part.front().stamp_ns;
      file.last_ns = part.back().stamp_ns;
    }
    if (Status s = write_trajectory(file.file, part); !s) return s.error();
    written.push_back(std::move(file));
  }
  std::error_code ignored;
  for (std::size_t next = count + 1;; ++next)
    if (!fs::remove(trajectory_file(path, next), ignored)) break;
  return written;
}

}  // namespace cairn
