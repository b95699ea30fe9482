#include "server/map/map.h"

#include <algorithm>

#include "server/map/delta.h"

namespace cairn {

LandmarkId Map::resolve(LandmarkId name) const {
  // Without cycles: an entry is erased when a landmark of its name is made again.
  while (!landmarks.contains(name)) {
    const FormerLandmark* former = replaced_landmarks.find(name);
    if (!former) return {};
    name = former->now;
  }
  return name;
}

KeyframeId Map::present(KeyframeId name) const {
  while (const FormerKeyframe* former = removed_keyframes.find(name)) name = former->anchor;
  return name;
}

std::optional<Rigid3> Map::pose_of(KeyframeId name) const {
  const auto scaled = scaled_pose_of(name);
  if (!scaled) return std::nullopt;
  return scaled->pose();
}

std::optional<Sim3> Map::scaled_pose_of(KeyframeId name) const {
  Sim3 name_from_camera;
  while (const FormerKeyframe* former = removed_keyframes.find(name)) {
    name_from_camera = former->anchor_from_camera * name_from_camera;
    name = former->anchor;
  }
  const KeyframeNode* node = keyframes.find(name);
  if (!node) return std::nullopt;
  return node->scaled_pose() * name_from_camera;
}

std::uint32_t Map::mapped_of(std::uint64_t epoch) const {
  const std::uint32_t* count = mapped_keyframes.find(epoch);
  return count ? *count : 0;
}

std::vector<KeyframeId> Map::unmapped() const {
  std::vector<KeyframeId> ids;
  keyframes.for_each([&](KeyframeId name, const KeyframeNode&) {
    if (name.sequence >= mapped_of(name.epoch)) ids.push_back(name);
  });
  std::sort(ids.begin(), ids.end(), [&](KeyframeId a, KeyframeId b) {
    return keyframes.at(a).arrival < keyframes.at(b).arrival;
  });
  return ids;
}

MapDelta MapDelta::based_on(const Map& snapshot) {
  MapDelta delta;
  delta.base_revision = snapshot.revision;
  delta.base_merge_epoch = snapshot.merge_epoch;
  return delta;
}

bool MapDelta::empty() const {
  return new_landmarks.empty() && new_observations.empty() && fusions.empty() &&
         removed_observations.empty() && removed_landmarks.empty() && poses.empty() &&
         positions.empty() && sightings.empty() && removed_keyframes.empty() &&
         mapped_keyframes.empty();
}

}  // namespace cairn
