// Step 1 of relocalisation: which feature of a view may show which landmark, by descriptor. Private
// to server/verify.
#pragma once

#include <cstdint>
#include <vector>

#include "server/map/map.h"
#include "server/verify/relocalise.h"

namespace cairn {

struct SeenLandmark {
  const Landmark* landmark;
  float angle;  // of the feature that shows it
};

struct ViewMatch {
  const Landmark* landmark;
  std::uint16_t feature;
};

// Each landmark once, in the order of the keyframes; those must be in the map.
std::vector<SeenLandmark> landmarks_seen_by(const Map& map,
                                            const std::vector<KeyframeId>& keyframes);

// Mutually nearest, distinctive on both sides, turned alike; in the order of `seen`. `from`: where
// the landmarks are seen from, which tells how far apart two of them must be to be two.
std::vector<ViewMatch> match_view(const Keyframe& view, const std::vector<SeenLandmark>& seen,
                                  const Eigen::Vector3d& from, const LocateOptions& options);

}  // namespace cairn
