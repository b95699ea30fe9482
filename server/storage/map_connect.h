// What the map file does not store because it follows from the rest: which landmark a feature
// shows, covisibility, children in the spanning tree. Private to server/storage.
#pragma once

#include "common/util/status.h"
#include "server/map/map.h"

namespace cairn::storage {

// Derives it. kCorrupt when relations lead nowhere or contradict each other.
Status connect(Map& map);

}  // namespace cairn::storage
