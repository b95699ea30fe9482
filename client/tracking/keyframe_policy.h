// When a tracked frame becomes a keyframe: when the view has changed so much that the map has
// little to say about it. Follows the conditions of the ORB-SLAM and ORB-SLAM2 papers.
#pragma once

#include <cstdint>

namespace cairn {

struct KeyframePolicyOptions {
  // A keyframe at least this often, as long as the mapper keeps up (frames; a second's worth).
  int max_frames_between = 30;
  // No keyframe sooner than this after the last one (frames), unless fewer than `few_landmarks` are
  // left in view. Bursts of keyframes while the camera turns fast fill the map with what blurred
  // images show, before the server has sorted out the first of them.
  int min_frames_between = 5;
  int few_landmarks = 50;
  // Of the landmarks that the reference keyframe shows, fewer than this share still in view calls
  // for a keyframe. Higher makes more keyframes. With less (0.33) a camera that turns on the spot
  // goes 35 degrees without one, held by landmarks at one edge of its images: up to 2 degrees of
  // drift.
  double min_shared = 0.45;
  // The same without depth, where every landmark takes two keyframes that see it from apart.
  double min_shared_mono = 0.7;
  // Below this share tracking is weak: a keyframe even when the mapper is busy.
  double weak_shared = 0.15;
  // The same without depth: a server that answers a second late must not starve tracking.
  double weak_shared_mono = 0.5;
  // Near points, whose depth gives scale and translation: fewer than `min_near_tracked` in view
  // while more than `min_near_new` could be added calls for a keyframe.
  int min_near_tracked = 100;
  int min_near_new = 70;
  // Keyframes that wait for the server's mapping beyond which it counts as busy.
  int max_backlog = 3;
};

struct KeyframeSituation {
  int frames_since_keyframe = 0;
  int shown_landmarks = 0;      // inliers of this frame
  int reference_landmarks = 0;  // that the reference keyframe shows
  int near_tracked = 0;         // features nearer than the rig's max_depth that show a landmark
  int near_new = 0;             // and such that show none
  int backlog = 0;              // keyframes sent that the server has not mapped; 0 without a server
};

bool wants_keyframe(const KeyframePolicyOptions& options, const KeyframeSituation& now);

}  // namespace cairn
