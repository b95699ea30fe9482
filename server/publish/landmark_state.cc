#include "server/publish/landmark_state.h"

#include <algorithm>

namespace cairn {

LandmarkState state_of(const Landmark& landmark) {
  LandmarkState state{.id = landmark.id,
                      .position = landmark.position,
                      .normal = landmark.normal,
                      .min_distance = landmark.min_distance,
                      .max_distance = landmark.max_distance,
                      .descriptor = landmark.descriptor,
                      .observers = {}};
  const auto& all = landmark.observations;
  const std::size_t count = std::min(all.size(), LandmarkState::kMaxObservers);
  for (std::size_t i = all.size() - count; i < all.size(); ++i)
    state.observers.push_back(all[i].keyframe);
  return state;
}

}  // namespace cairn
