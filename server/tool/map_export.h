// What a map holds, in a few figures, and the map in formats of other programs.
//
// All writers are deterministic: keyframes and landmarks in ascending order of their ids. Streams
// are the caller's to check. Poses are map_from_camera, metres, unless a format says otherwise.
#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "common/model/trajectory.h"
#include "common/util/status.h"
#include "server/map/map.h"

namespace cairn {

struct MapInfo {
  struct Run {  // one run of one client
    std::uint64_t epoch = 0;
    std::string client;  // its name, where known: the map itself has epochs only
    std::size_t keyframes = 0;
    double path_m = 0;      // length of the polygon through its keyframes
    double duration_s = 0;  // from its first to its last keyframe
  };
  struct Loop {  // closed, or with another part merged by it
    bool merges = false;
    KeyframeId query, candidate;
    int inliers = 0;
    std::optional<bool> can_undo;  // the map file knows
  };

  std::uint64_t id = 0, revision = 0;
  std::uint32_t merge_epoch = 0;
  std::size_t keyframes = 0, landmarks = 0, observations = 0;
  std::vector<Run> runs;    // by epoch
  std::vector<Loop> loops;  // in order; the first is event 1

  // Of a run; "?" when unknown.
  std::string client_of(std::uint64_t epoch) const;
  // Corners of the box around all landmarks, metres in map; both 0 without landmarks.
  Eigen::Vector3d box_min = Eigen::Vector3d::Zero(), box_max = Eigen::Vector3d::Zero();
  double mean_observations = 0;  // a landmark
  double reprojection_rmse = 0;  // pixels, over all observations
};
MapInfo info_of(const Map& map);
// One JSON object.
void write_info_json(const MapInfo& info, std::ostream& out);

// Keyframe poses of one client run, by time.
Trajectory keyframe_trajectory(const Map& map, std::uint64_t epoch);

// TUM trajectory format; one block a client run, led by a comment that names it.
void write_tum(const Map& map, std::ostream& out);
// Point cloud in ASCII PLY: landmarks in grey, camera positions in red.
void write_ply(const Map& map, std::ostream& out);
// Everything but the descriptors: {"info", "keyframes", "landmarks"}.
void write_json(const Map& map, const MapInfo& info, std::ostream& out);

// COLMAP's text format (https://colmap.github.io/format.html). COLMAP's pixel (0.5, 0.5) is our
// (0, 0), and its poses are camera_from_world. Images are named EPOCH/SECONDS.png.
void write_colmap_cameras(const Map& map, std::ostream& out);
void write_colmap_images(const Map& map, std::ostream& out);
void write_colmap_points(const Map& map, std::ostream& out);

enum class MapFormat { kTum, kPly, kColmap, kJson };
// Writes to the file `path`, or for COLMAP to cameras.txt, images.txt and points3D.txt in the
// folder `path`, which is made where it is missing. `info` is of the map, with what else is known.
Status export_map(const Map& map, const MapInfo& info, MapFormat format, const std::string& path);

}  // namespace cairn
