// New landmarks from features that show none yet in a keyframe and in one of its neighbours.
#pragma once

#include <cstddef>

#include "common/feature/epipolar_match.h"
#include "server/map/delta.h"
#include "server/mapping/keyframe_view.h"

namespace cairn {

struct TriangulateOptions {
  std::size_t neighbours = 10;       // most covisible ones to search
  std::size_t neighbours_mono = 20;  // where no depth is measured, a point needs the best baseline
  PairOptions pair;
};

// Landmarks seen by the keyframe `id` (the reference) and one neighbour each; further views are the
// task of fuse; the pairs come from triangulate_pairs(). Deterministic. An empty delta when the
// keyframe is gone.
MapDelta triangulate(const Map& map, KeyframeId id, const TriangulateOptions& options = {});

}  // namespace cairn
