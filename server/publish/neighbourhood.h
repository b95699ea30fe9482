// The part of the map around a keyframe.
#pragma once

#include <vector>

#include "server/map/map.h"

namespace cairn {

// The keyframe itself, those that share landmarks with it, strongest first, then those that share
// landmarks with these: at most `limit` in all. Empty when the map has no such keyframe.
std::vector<const KeyframeNode*> neighbourhood(const Map& map, KeyframeId centre,
                                               std::size_t limit);

}  // namespace cairn
