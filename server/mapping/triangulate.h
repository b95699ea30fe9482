// New landmarks from features that show none yet in a keyframe and in one of its neighbours.
#pragma once

#include <cstddef>

#include "server/map/delta.h"
#include "server/mapping/keyframe_view.h"

namespace cairn {

struct TriangulateOptions {
  std::size_t neighbours = 10;       // most covisible ones to search; 20 suit monocular cameras
  int max_distance = 50;             // bits in which the two descriptors may differ
  double ratio = 0.8;                // best distance over second best on the epipolar line
  double max_relative_sigma = 0.15;  // of the distance; 0.15 is about 1 degree of parallax
  double scale_tolerance = 1.8;      // octaves must agree with distances within this factor
};

// Landmarks seen by the keyframe `id` (the reference) and one neighbour each; further views are the
// task of fuse. For each pair of keyframes: match along epipolar lines, by descriptor, distinct and
// with one common turn of the orientation; triangulate, using depth where it was measured; keep
// what lies in front of both, reprojects well in both, is certain enough and agrees in scale.
// Deterministic. An empty delta when the keyframe is gone.
MapDelta triangulate(const Map& map, KeyframeId id, GridCache& grids,
                     const TriangulateOptions& options = {});

}  // namespace cairn
