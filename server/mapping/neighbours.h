// Keyframes that share a scene.
#pragma once

#include <vector>

#include "server/map/map.h"

namespace cairn {

// The `count` most covisible keyframes, strongest first, and its parent where that is not among
// them (the one that a keyframe without shared landmarks hangs on).
std::vector<KeyframeId> best_covisible(const Map& map, KeyframeId id, std::size_t count);

// Whom to ask for landmarks in common: best_covisible(`first`), then up to `limit` in all those of
// first and second order that should see most of what they are not known to share with `id`, by
// where the cameras are. Without these, runs that have come together would stay strangers: each
// keyframe shares most with others of its own run. Without `id` itself and without repeats.
std::vector<KeyframeId> neighbourhood(const Map& map, KeyframeId id, std::size_t first,
                                      std::size_t limit);

// All landmarks that the keyframes see, ascending, without repeats.
std::vector<LandmarkId> landmarks_of(const Map& map, const std::vector<KeyframeId>& keyframes);

}  // namespace cairn
