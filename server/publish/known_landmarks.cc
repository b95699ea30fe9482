#include "server/publish/known_landmarks.h"

namespace cairn {

KnownLandmarks::Slot KnownLandmarks::know(LandmarkId id) {
  if (const auto found = find(id)) return *found;
  Slot slot = static_cast<Slot>(slots_.size());
  if (free_.empty()) {
    slots_.emplace_back();
  } else {
    slot = free_.back();
    free_.pop_back();
  }
  slots_[slot].id = id;
  slot_of_.emplace(id, slot);
  return slot;
}

std::optional<KnownLandmarks::Slot> KnownLandmarks::find(LandmarkId id) const {
  const auto found = slot_of_.find(id);
  if (found == slot_of_.end()) return std::nullopt;
  return found->second;
}

void KnownLandmarks::forget(Slot slot) {
  slot_of_.erase(slots_[slot].id);
  slots_[slot] = {};
  free_.push_back(slot);
}

void KnownLandmarks::clear() {
  slots_.clear();
  free_.clear();
  slot_of_.clear();
}

}  // namespace cairn
