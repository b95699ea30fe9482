// A loop that was closed, as an event of the map: two keyframes that see the same place and had not
// been connected. When they lie in parts of the map that nothing connected (those of two clients
// that had never met, or of a client before and after it was lost), the same event merges the
// parts.
#pragma once

#include "server/map/delta.h"

namespace cairn {

// `correction` moves keyframes and landmarks to where the loop says, and fuses what both sides saw;
// based on the snapshot that the loop was verified in.
struct LoopClosure {
  LoopEdge edge;
  MapDelta correction;
};

}  // namespace cairn
