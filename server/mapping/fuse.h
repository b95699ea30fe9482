// Finds what two keyframes both see without knowing: adds observations, and joins landmarks that
// stand for the same point.
#pragma once

#include <cstddef>

#include "server/map/delta.h"
#include "server/mapping/keyframe_view.h"

namespace cairn {

struct FuseOptions {
  std::size_t first = 10, limit = 20;  // neighbours, see neighbourhood()
  double radius = 3.0;                 // pixels at octave 0, around the projection
  int max_distance = 50;               // bits in which the descriptors may differ
};

// kInto: landmarks of the neighbours are looked for in the keyframe; kFrom: its own in them.
enum class FuseDirection { kInto, kFrom, kBoth };

// Projects the landmarks of the keyframe into its neighbours, and those of the neighbours into the
// keyframe. Where a free feature fits, the landmark gets an observation; where one fits that shows
// another landmark, the two are fused, in favour of the one with more observations (of the smaller
// id, if equal). Deterministic; empty when the keyframe is gone.
MapDelta fuse(const Map& map, KeyframeId id, GridCache& grids, const FuseOptions& options = {},
              FuseDirection direction = FuseDirection::kBoth);

}  // namespace cairn
