// The events of a map, as functions from one valid map to the next. Each one that changes anything
// takes the map to its next revision. Deterministic; not thread-safe: a map that others see is
// changed by its MapWriter alone (map_writer.h).
#pragma once

#include "server/map/delta.h"
#include "server/map/loop.h"
#include "server/map/map.h"

namespace cairn {

struct KeyframeSummary {
  bool inserted = false;  // false: the map has or had a keyframe of that id, nothing was done
  int accepted = 0;       // matches with landmarks that the map had
  int created = 0;        // landmarks made from depth or from two views
  int rejected = 0;       // matches that contradict the map, or with landmarks that are gone
};

// Inserts a keyframe.
//
// Pose and own unit: those of its reference times reference_from_camera, so that it comes to lie
// right also where the map's scale has changed since it was made. Where the reference is unknown:
// relative to the client's keyframe before it, by odometry; where the map has none of the client,
// at its odom_from_camera, so that map and odom agree: the client may be far into its run when a
// server without its former map takes over. The first keyframe of a run is the identity in an empty
// map.
//
// Each reported match is followed through replaced_landmarks and taken when the landmark projects
// near the feature and the keyframe does not see it by another feature. A match that names this
// very keyframe and feature makes that landmark from the feature's depth. A match with a client's
// landmark that is not in the map is taken to mean the feature that it was named after: the
// landmark which that feature shows now or, if none, one made from its depth; where neither feature
// has depth, one triangulated from both. That is how monocular clients make landmarks.
KeyframeSummary apply_keyframe(Map& map, KeyframePtr keyframe);

struct DeltaSummary {
  // The delta was computed before a merge or loop closure: nothing was done.
  bool is_void = false;
  int landmarks_made = 0, landmarks_removed = 0, fused = 0, landmarks_moved = 0;
  int observations_added = 0, observations_removed = 0;
  int poses_changed = 0, keyframes_removed = 0;
  int carried = 0;  // keyframes and landmarks that came after the snapshot and moved along
  int dropped = 0;  // changes whose ids are gone or that contradict the map's present state
};

// Applies a delta to a map that may have moved on since (delta.h).
//
// A keyframe that came after the delta's snapshot moves with its reference, or else its parent, if
// that one is changed or carried itself: it keeps its pose relative to it, in its unit. Landmarks
// that came after the snapshot move with their reference keyframe.
DeltaSummary apply_delta(Map& map, const MapDelta& delta);

// Applies a loop's correction and remembers its edge. From then on what was computed before is void
// (DeltaSummary::is_void): it starts from places that have changed by more than a little. So is the
// closure itself, and nothing is done, when another one came before it.
DeltaSummary apply_loop(Map& map, const LoopClosure& closure);

// Takes a keyframe out. Its children get another parent: the most covisible one that does not
// descend from them, or the removed one's parent. The map remembers its pose relative to its parent
// (removed_keyframes); landmarks that less than two others see vanish. False for roots and unknown
// ones.
bool remove_keyframe(Map& map, KeyframeId id);

// Forgets what became of landmarks and keyframes that ended so many keyframes ago, so that these
// tables are bounded by the pace of change and not by the map's age. Now and then only, when the
// map has been given a round number of keyframes; apply_keyframe() does it.
//
// Who still uses so old a name loses little: a match with a landmark of a client's making means
// what its feature shows now or is made anew from that feature's depth; others are rejected, and
// found again by where they lie (fuse.h). A client keeps the place that it has for the keyframe.
// Landmarks are kept for less long, as a keyframe ends hundreds of them where others have mapped
// before.
void forget_former(Map& map);
inline constexpr std::uint64_t kFormerKeyframesKept = 5000, kFormerLandmarksKept = 1000;

// Descriptor, normal and distances of a landmark from its observations (refresh.h). The functions
// above do it for all that they touch.
void refresh_landmark(const Map& map, Landmark& landmark);

// Squared error of a landmark's projection over its variance, 2 degrees of freedom for features
// without depth and 3 for those with it; infinite behind the camera. The 95 % quantiles are 5.99
// and 7.81 (kChi2Pixel, kChi2Depth).
double reprojection_chi2(const KeyframeNode& node, std::uint16_t feature,
                         const Eigen::Vector3d& point_in_map);
inline constexpr double kChi2Pixel = 5.99, kChi2Depth = 7.81;

}  // namespace cairn
