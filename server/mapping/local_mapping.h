// What the server does with each keyframe that has arrived, step by step:
//
//   fuse (kInto)     landmarks of the neighbours that it sees, and nobody reported;
//                    those that failed their trial go
//   triangulate      new landmarks, from what it then still sees without knowing
//   fuse (kFrom)     its landmarks in the neighbours;
//                    what was found where it should be is counted
//
// and then, for keyframes of all clients together (local_adjuster.h):
//
//   solve            local bundle adjustment, poses and landmarks; counts as mapped from here on
//   cull_keyframes   keyframes that say nothing new go
//
// Each of these is a delta (step.h). The method is that of ORB-SLAM (Mur-Artal et al. 2015, section
// VI), but for the search before triangulation: keyframes come from a client whose local map may
// lack what the server has.
#pragma once

#include <cstddef>

#include "server/map/map_writer.h"
#include "server/mapping/cull.h"
#include "server/mapping/fuse.h"
#include "server/mapping/keyframe_view.h"
#include "server/mapping/triangulate.h"

namespace cairn {

struct LocalMappingOptions {
  TriangulateOptions triangulate;
  FuseOptions fuse;
  CullOptions cull;
  std::size_t sighting_neighbours = 10;
  std::size_t hurry_from = 4;  // keyframes that wait
};

struct LocalMappingReport {
  bool found = false;   // false: the map has no such keyframe (any more)
  double total_ms = 0;  // waiting for the writer included
  int landmarks_culled = 0, landmarks_made = 0, observations_added = 0, fused = 0;
};

// One for each client run. Not thread-safe: one thread at a time calls extend(), for each keyframe
// in order of arrival.
class LocalMapping {
 public:
  // `writer` must outlive this.
  explicit LocalMapping(MapWriter& writer, const LocalMappingOptions& options = {});

  // The steps up to the solve. With more than `hurry_from` keyframes waiting behind this one, half
  // as many neighbours are asked for landmarks in common.
  LocalMappingReport extend(KeyframeId id, std::size_t waiting = 0);

 private:
  MapWriter& writer_;
  const LocalMappingOptions options_;
  GridCache grids_;
};

}  // namespace cairn
