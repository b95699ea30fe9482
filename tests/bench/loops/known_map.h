// Maps that the real programs have made of walks through known places, with the truth about where
// each keyframe was.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/model/trajectory.h"
#include "common/util/status.h"
#include "server/map/map.h"

namespace cairn::bench {

// What one client sees.
struct WalkInput {
  std::string source;            // for cairn-client --input
  std::filesystem::path config;  // of cairn-client
  Trajectory truth;
};

// An embedded scene, "SCENE?key=value&...".
Result<WalkInput> synthetic_walk(const std::string& spec);
// Frames `first` to `last`-1 of a recording in TUM layout, which is in $CAIRN_DATA or
// ../shared/data; `folder` gets a list of these frames. kNotFound: it is not there.
Result<WalkInput> recorded_walk(const std::string& recording, const std::string& config,
                                std::size_t first, std::size_t last,
                                const std::filesystem::path& folder);

struct KnownMap {
  std::string name;
  Map map;
  std::unordered_map<KeyframeId, Rigid3> world_from_camera;
  std::string server_log;  // of the run that made it
};

struct MapRun {
  std::string name;
  std::vector<WalkInput> walks;  // of clients that come one after the other
  bool close_loops = false;
  // Where map files are kept for the next time, and taken from; empty: nowhere.
  std::filesystem::path keep;
};
// In lockstep, so that it can be repeated. Keyframes without a truth are left out of the latter.
Result<KnownMap> make_known_map(const MapRun& run);

// Both in one, as if the clients of `b` had come after those of `a`, to another place: nothing in
// common, and the truth of both far apart.
KnownMap side_by_side(const KnownMap& a, const KnownMap& b);

}  // namespace cairn::bench
