#include "server/publish/landmark_state.h"

#include <algorithm>

namespace cairn {

LandmarkState state_of(const Landmark& landmark, std::optional<OwnFeature> shown_by) {
  LandmarkState state{.id = landmark.id,
                      .position = landmark.position,
                      .normal = landmark.normal,
                      .min_distance = landmark.min_distance,
                      .max_distance = landmark.max_distance,
                      .descriptor = shown_by ? Descriptor{} : landmark.descriptor,
                      .shown_by = shown_by,
                      .observers = {}};
  const auto& all = landmark.observations;
  const std::size_t count = std::min(all.size(), LandmarkState::kMaxObservers);
  for (std::size_t i = all.size() - count; i < all.size(); ++i)
    state.observers.push_back(all[i].keyframe);
  // The one that it moves with is never left out.
  auto& told = state.observers;
  const KeyframeId reference = landmark.reference;
  if (reference.is_valid() && count < all.size() &&
      std::find(told.begin(), told.end(), reference) == told.end())
    told.front() = reference;
  return state;
}

}  // namespace cairn
