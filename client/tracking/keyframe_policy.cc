#include "client/tracking/keyframe_policy.h"

namespace cairn {

bool wants_keyframe(const KeyframePolicyOptions& options, const KeyframeSituation& now) {
  if (now.frames_since_keyframe < options.min_frames_between &&
      now.shown_landmarks >= options.few_landmarks)
    return false;
  const bool needs_near =
      now.near_tracked < options.min_near_tracked && now.near_new > options.min_near_new;
  const bool view_changed =
      now.shown_landmarks < options.min_shared * now.reference_landmarks || needs_near;
  if (!view_changed) return false;

  const bool overdue = now.frames_since_keyframe >= options.max_frames_between;
  const bool weak =
      now.shown_landmarks < options.weak_shared * now.reference_landmarks || needs_near;
  const bool mapper_idle = now.backlog == 0;
  return (overdue || weak || mapper_idle) ? now.backlog < options.max_backlog || weak : false;
}

}  // namespace cairn
