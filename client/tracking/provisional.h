// Landmarks of a camera without depth: points that a new keyframe and earlier ones see without
// knowing. Made on the client, so that tracking goes on whenever the server's come; the server
// makes the same from the keyframe's matches, and refines them.
#pragma once

#include <cstddef>
#include <vector>

#include "client/tracking/local_map.h"
#include "client/tracking/tracked_frame.h"
#include "common/feature/epipolar_match.h"

namespace cairn {

struct ProvisionalOptions {
  std::size_t neighbours = 5;  // keyframes that the new one is compared with
  // How far such a keyframe must be, as a share of the median depth: nearer ones tell no depth.
  double min_baseline = 0.02;
  // Less certain points than the server would take: they need not last, and where the camera mostly
  // turns there are no others.
  PairOptions pair{.max_relative_sigma = 0.4};
};

// Of the features of a tracked frame that show nothing yet; each at most once, and so each feature
// of an earlier keyframe. About a millisecond a neighbour. Deterministic.
std::vector<ProvisionalLandmark> triangulate_provisional(const LocalMap& map,
                                                         const TrackedFrame& frame,
                                                         const ProvisionalOptions& options);

}  // namespace cairn
