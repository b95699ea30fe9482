// Chooses what local bundle adjustment works on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/map/map.h"
#include "server/map/window.h"

namespace cairn {

struct LocalWindowOptions {
  std::size_t max_free = 15;
  // So many times as many around a keyframe without depth: what holds the scale lies further back.
  // On 7-Scenes kitchen the error falls from 0.0253 to 0.0245 m; ORB-SLAM has no limit at all.
  std::size_t mono_times = 2;
  std::size_t max_fixed = 25;
  int min_shared = 15;  // landmarks with the new keyframes, to be solved for along with them
  // Landmarks that others see most come first; one is left out once all free keyframes that see it
  // have so many.
  std::size_t landmarks_each = SIZE_MAX;
};

// The new keyframes (`centres`, those gone are skipped) and the ones most covisible with them are
// free, with the landmarks that they see; of the others that see these landmarks, those that see
// most are fixed. Roots are fixed always; where nothing else would hold the frame, the oldest of
// the free ones is.
LocalWindow choose_local_window(const Map& map, std::span<const KeyframeId> centres,
                                const LocalWindowOptions& options = {});

// The free ones of that window, without the work of choosing the rest; where nothing else would
// hold the frame, the one that would be held is among them.
std::vector<KeyframeId> choose_free_keyframes(const Map& map, std::span<const KeyframeId> centres,
                                              const LocalWindowOptions& options = {});

}  // namespace cairn
