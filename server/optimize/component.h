// Parts of a map that hang together by shared landmarks or by the spanning tree. Unlike with
// connected_keyframes() closed loops don't count: an adjustment needs what holds the two together.
// Parts of clients
// that have not met yet are components of their own.
#pragma once

#include <vector>

#include "server/map/map.h"

namespace cairn {

// The keyframes of the component that holds `of`, ascending; none where the map does not have it.
std::vector<KeyframeId> component_of(const Map& map, KeyframeId of);

// All components, each ascending, ordered by their first keyframe.
std::vector<std::vector<KeyframeId>> components(const Map& map);

// The keyframe that came first: by arrival, then by stamp, then by id. `keyframes` is not empty and
// all of it is in the map.
KeyframeId oldest(const Map& map, const std::vector<KeyframeId>& keyframes);

}  // namespace cairn
