// Chooses what local bundle adjustment works on.
#pragma once

#include <cstddef>
#include <span>

#include "server/map/map.h"
#include "server/map/window.h"

namespace cairn {

struct LocalWindowOptions {
  std::size_t max_free = 15;
  std::size_t max_fixed = 25;
  int min_shared = 15;  // landmarks with the new keyframes, to be solved for along with them
};

// The new keyframes (`centres`, those gone are skipped) and the ones most covisible with them are
// free, with all landmarks that they see; of the others that see these landmarks, those that see
// most are fixed. Roots are fixed always; where nothing else would hold the frame, the oldest of
// the free ones is.
LocalWindow choose_local_window(const Map& map, std::span<const KeyframeId> centres,
                                const LocalWindowOptions& options = {});

}  // namespace cairn
