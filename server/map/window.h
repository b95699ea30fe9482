// The part of a map that local bundle adjustment works on.
#pragma once

#include <vector>

#include "common/model/ids.h"

namespace cairn {

// All ids ascending, without repeats, and in the snapshot that the window was chosen from.
// Chosen by server/mapping/local_window.h, solved by server/optimize.
struct LocalWindow {
  std::vector<KeyframeId> free_keyframes;   // poses to be solved for
  std::vector<KeyframeId> fixed_keyframes;  // see the landmarks too, hold the frame; may be empty
  std::vector<LandmarkId> landmarks;        // that the free keyframes see, all or most of them
};

}  // namespace cairn
