// The step that matching and pose solving share: solve the frame's pose from its matches and drop
// those that do not fit.
#pragma once

#include "client/tracking/tracked_frame.h"

namespace cairn {

// Sets frame.map_from_camera and unmatches outliers: what lies beyond frame.slack, or, in a view
// far worse than that, beyond the usual bound. Returns how many landmarks (passing points not
// counted) remain.
int refine_pose(TrackedFrame& frame);

}  // namespace cairn
