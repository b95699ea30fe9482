// Finds the pose of a frame without any guess, from the client's own keyframes.
#pragma once

#include "client/tracking/local_map.h"
#include "client/tracking/tracked_frame.h"

namespace cairn {

// Matches the frame to one keyframe by looks, finds a pose that most matches agree with (P3P in a
// RANSAC loop), refines it and looks for more landmarks around it. True, with frame.map_from_camera
// and frame.matches set, when at least `min_inliers` landmarks agree; otherwise the frame's matches
// come back empty. Deterministic.
bool relocalise_against(const Keyframe& keyframe, LocalMap& map, int min_inliers,
                        TrackedFrame& frame);

}  // namespace cairn
