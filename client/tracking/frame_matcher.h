// Finds landmarks in a frame: by where they should project, or by looks alone.
#pragma once

#include <span>
#include <vector>

#include "client/tracking/local_map.h"
#include "client/tracking/tracked_frame.h"

namespace cairn {

// Each of these adds matches for features that have none yet, never changes those that have, and
// returns how many it added. A landmark that the frame already shows is not looked for again; a
// feature wanted by several landmarks goes to the one that looks most like it.

// Frame to frame: `frame.map_from_camera` is the predicted pose. What `last` showed, and its
// features with depth that showed nothing, are looked for within `radius` pixels (at octave 0; it
// grows with the octave) at about the octave where `last` found them. Matches whose orientation
// turned otherwise than most others' are dropped.
int match_to_last_frame(const TrackedFrame& last, const LocalMap& map, double radius,
                        TrackedFrame& frame);

// Map to frame: landmarks in view of `frame.map_from_camera`, at the octave that their distance
// makes likely, seen from not too different a direction, within about `radius` pixels.
int match_to_landmarks(std::span<const LocalLandmark* const> landmarks, double radius,
                       TrackedFrame& frame);

// Keyframe to frame, by looks alone: for when no pose is known. One landmark of the keyframe
// against every feature, mutual best, with ratio and orientation checks.
int match_to_keyframe(const Keyframe& keyframe, const LocalMap& map, TrackedFrame& frame);

}  // namespace cairn
