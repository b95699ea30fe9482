// Which keyframes belong together: the parts of a map.
#pragma once

#include <vector>

#include "server/map/map.h"

namespace cairn {

// The part of the map that `id` lies in: every keyframe that covisibility, the spanning tree and
// closed loops lead to, itself included; ascending. Empty when the map does not have it. Parts of
// clients that have not met are apart. Visits the whole part.
std::vector<KeyframeId> connected_keyframes(const Map& map, KeyframeId id);

// Where the spanning tree that holds `id` has its root; not valid when the map does not have `id`.
// Keyframes of one root are in one part. Those of one part have one root, but for map files from
// before parts that merge were hung on each other.
KeyframeId root_of(const Map& map, KeyframeId id);

// Whether that part has a scale in metres: some keyframe in it is of a sensor with depth. Visits no
// more of it than it takes to find one; false when the map does not have `id`.
bool is_metric(const Map& map, KeyframeId id);

}  // namespace cairn
