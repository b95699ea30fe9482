// What a client makes of a walk through a synthetic scene: its keyframes, recorded once without a
// server, so that many clients can be replayed on a machine that could not track for all of them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common/model/keyframe.h"
#include "common/model/trajectory.h"
#include "common/util/status.h"

namespace cairn::bench {

struct WalkOptions {
  std::string scene = "desk";
  int path = 0;
  int frames = 600;  // at 30 a second
  // Of the landmarks of its reference, a keyframe where fewer are in view: more keyframes than a
  // client makes by default, for load.
  double min_shared = 0.8;
  std::filesystem::path folder;  // where recordings are kept for the next run
};

struct RecordedWalk {
  std::string name;  // of the client
  std::vector<KeyframePtr> keyframes;
  Trajectory truth;  // world_from_camera of every frame
};

// `count` walks, on paths from options.path on, otherwise alike. Runs cairn-client for those that
// the folder does not have, and says on stderr, as `program`, how far it is. Error: it failed.
Result<std::vector<RecordedWalk>> record_walks(const WalkOptions& options, int count,
                                               const std::string& program);

// The same keyframes as another client's run would have them.
RecordedWalk as_new_run(const RecordedWalk& walk, const std::string& name, std::uint64_t epoch);

}  // namespace cairn::bench
