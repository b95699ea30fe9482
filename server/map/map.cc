#include "server/map/map.h"

#include "server/map/delta.h"

namespace cairn {

LandmarkId Map::resolve(LandmarkId name) const {
  // Without cycles: an entry is erased when a landmark of its name is made again.
  while (const LandmarkId* next = replaced_landmarks.find(name)) name = *next;
  return landmarks.contains(name) ? name : LandmarkId{};
}

std::optional<Rigid3> Map::pose_of(KeyframeId name) const {
  Rigid3 name_from_camera;
  while (const KeyframeRemoval* removal = removed_keyframes.find(name)) {
    name_from_camera = removal->anchor_from_camera * name_from_camera;
    name = removal->anchor;
  }
  const KeyframeNode* node = keyframes.find(name);
  if (!node) return std::nullopt;
  return node->map_from_camera * name_from_camera;
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
         positions.empty() && sightings.empty() && removed_keyframes.empty();
}

}  // namespace cairn
