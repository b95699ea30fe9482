// What the server does with each keyframe that has arrived, step by step:
//
//   cull_landmarks   landmarks that failed their trial go
//   fuse (kInto)     landmarks of the neighbours that it sees, and nobody reported
//   triangulate      new landmarks, from what it then still sees without knowing
//   fuse (kFrom)     its landmarks in the neighbours
//   count_sightings  what was found where it should be
//   solve            local bundle adjustment, poses and landmarks; counts as mapped from here on
//   cull_keyframes   keyframes that say nothing new go
//
// Each step computes a delta from the newest snapshot, sends it to the map's writer and waits until
// it is applied; a loop closed in between makes the delta void, and the step is taken again. The
// method is that of ORB-SLAM (Mur-Artal et al. 2015, section VI), but for the
// search before triangulation: keyframes come from a client whose local map may lack what the
// server has.
#pragma once

#include <cstddef>
#include <functional>
#include <stop_token>
#include <vector>

#include "server/map/map_writer.h"
#include "server/map/window.h"
#include "server/mapping/cull.h"
#include "server/mapping/fuse.h"
#include "server/mapping/keyframe_view.h"
#include "server/mapping/local_window.h"
#include "server/mapping/triangulate.h"

namespace cairn {

// Solves for the free keyframes and the landmarks of the window; based on the given map. Returns
// early, with what it has, when asked to stop.
using LocalSolver =
    std::function<MapDelta(const Map& map, const LocalWindow& window, std::stop_token stop)>;

struct LocalMappingOptions {
  TriangulateOptions triangulate;
  FuseOptions fuse;
  CullOptions cull;
  LocalWindowOptions window;
  std::size_t sighting_neighbours = 10;
  // While more keyframes wait, the solver runs for this many together instead of for each.
  std::size_t max_coalesced = 6;
};

// Milliseconds that each step took, waiting for the writer included, and what came of it.
struct LocalMappingReport {
  bool found = false;   // false: the map has no such keyframe (any more)
  bool solved = false;  // false: left to a later keyframe
  double cull_landmarks_ms = 0, triangulate_ms = 0, sightings_ms = 0;
  double fuse_ms = 0;  // both directions
  double window_ms = 0, solve_ms = 0, cull_keyframes_ms = 0, total_ms = 0;
  int landmarks_culled = 0, landmarks_made = 0, observations_added = 0, fused = 0;
  int keyframes_culled = 0;
};

// One a map. Not thread-safe: one thread calls map_keyframe, for each keyframe in order of arrival.
class LocalMapping {
 public:
  // `writer` must outlive this. Without a solver that step is left out.
  LocalMapping(MapWriter& writer, LocalSolver solver, const LocalMappingOptions& options = {});

  // `backlog`: keyframes that wait behind this one. With a stop asked for it returns after the step
  // at hand; the map is valid at any time.
  LocalMappingReport map_keyframe(KeyframeId id, std::size_t backlog, std::stop_token stop = {});

 private:
  using Step = std::function<MapDelta(const Map&)>;
  DeltaSummary submit(const Step& step);
  void fuse_with_neighbours(KeyframeId id, FuseDirection direction, LocalMappingReport& report);
  void extend(KeyframeId id, LocalMappingReport& report);
  void solve(LocalMappingReport& report, std::stop_token stop);
  void cull_around(KeyframeId id, LocalMappingReport& report);

  MapWriter& writer_;
  LocalSolver solver_;
  LocalMappingOptions options_;
  GridCache grids_;
  std::vector<KeyframeId> unsolved_;  // arrived since the solver ran last
};

}  // namespace cairn
