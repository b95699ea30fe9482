#include <cmath>
#include <string>

#include "common/wire/keyframe_codec.h"
#include "common/wire/map_update_codec.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

constexpr double kMaxPosition = 1e7;  // metres
constexpr double kNormalTolerance = 1e-3;

Status unsound(const std::string& what) {
  return {ErrorCode::kInvalidArgument, "map update: " + what};
}

// Which says too that no id stands twice in a list.
template <typename List>
bool is_ascending(const List& list) {
  for (std::size_t i = 1; i < list.size(); ++i)
    if (!(list[i - 1].id < list[i].id)) return false;
  return true;
}

// NaN fails the comparison.
bool is_position(const Eigen::Vector3d& p) {
  return p.allFinite() && p.cwiseAbs().maxCoeff() <= kMaxPosition;
}

bool is_sound(const LandmarkState& l) {
  if (!wire::is_sound(l.id) || l.observers.size() > LandmarkState::kMaxObservers) return false;
  if (!is_position(l.position)) return false;
  const double norm = l.normal.norm();
  if (norm != 0 && !(std::abs(norm - 1) <= kNormalTolerance)) return false;
  if (!(l.min_distance >= 0 && l.min_distance <= l.max_distance && l.max_distance <= kMaxPosition))
    return false;
  if (l.shown_by && l.shown_by->feature >= kMaxFeatures) return false;
  for (const KeyframeId& id : l.observers)
    if (!id.is_valid()) return false;
  return true;
}

bool is_sound(const KeyframeRemoval& r) {
  return r.id.is_valid() && r.anchor.is_valid() && r.anchor != r.id &&
         wire::is_sound(r.anchor_from_camera);
}

bool is_sound(const std::vector<PartOfRun>& parts) {
  for (std::size_t i = 1; i < parts.size(); ++i)
    if (parts[i - 1].first >= parts[i].first) return false;
  return parts.empty() || parts.front().first == 0;
}

bool is_sound(const LandmarkRemoval& r) {
  return wire::is_sound(r.id) &&
         (!r.replaced_by || (wire::is_sound(*r.replaced_by) && *r.replaced_by != r.id));
}

}  // namespace

Status check_map_update(const MapUpdate& update) {
  if (update.map.value == 0) return unsound("map id is zero");
  if (update.epoch == 0) return unsound("epoch is zero");
  if (update.revision <= update.base_revision) return unsound("revision does not grow");
  if (update.new_map_from_old_map && !wire::is_sound(*update.new_map_from_old_map))
    return unsound("motion of the map is no similarity");
  if (!is_position(update.centre)) return unsound("impossible centre");
  for (const auto& k : update.keyframes)
    if (!k.id.is_valid() || !wire::is_sound(k.map_from_camera))
      return unsound("keyframe with an impossible id or pose");
  if (!is_sound(update.parts)) return unsound("parts of the run out of order");
  for (const auto& r : update.removed_keyframes)
    if (!is_sound(r)) return unsound("removed keyframe with an impossible id, anchor or pose");
  for (const auto& l : update.landmarks)
    if (!is_sound(l)) return unsound("landmark with an impossible id or value");
  for (const auto& l : update.moved_landmarks)
    if (!wire::is_sound(l.id) || !is_position(l.position))
      return unsound("moved landmark with an impossible id or position");
  for (const auto& r : update.removed_landmarks)
    if (!is_sound(r)) return unsound("removed landmark with an impossible id");
  if (!is_ascending(update.keyframes) || !is_ascending(update.removed_keyframes) ||
      !is_ascending(update.landmarks) || !is_ascending(update.moved_landmarks) ||
      !is_ascending(update.removed_landmarks))
    return unsound("a list does not ascend by id");
  return {};
}

}  // namespace cairn::wire
