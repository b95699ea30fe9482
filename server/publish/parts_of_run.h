// Which keyframes of a client's run hang together: a client that was lost may have been in several
// parts of the map, each in a frame of its own.
#pragma once

#include <cstdint>
#include <vector>

#include "common/model/map_update.h"
#include "server/map/map.h"

namespace cairn {

// Of keyframes 0 .. count-1 of the run, culled ones included; parts are numbered in the order in
// which the run has come to them. A keyframe that the map does not have, because another server's
// held it, counts to the one before. Empty where the map has none. Goes through as much of the
// spanning tree as lies between the keyframes and their roots, once.
std::vector<PartOfRun> parts_of_run(const Map& map, std::uint64_t epoch, std::uint32_t count);

}  // namespace cairn
