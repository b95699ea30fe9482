// A step of mapping: a delta computed from the newest snapshot, sent to the map's writer. A loop
// closed in between makes the delta void, and the step is taken again.
#pragma once

#include <functional>

#include "common/util/clock.h"
#include "server/map/map_writer.h"

namespace cairn {

using Step = std::function<MapDelta(const Map&)>;

// Waits until the step is applied; says what came of it. Nothing is sent when there is nothing to
// change. From any thread.
DeltaSummary take_step(MapWriter& writer, const Step& step);

// Milliseconds since the last call.
double lap(Stopwatch& watch);

}  // namespace cairn
