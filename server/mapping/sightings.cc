#include "server/mapping/sightings.h"

#include <algorithm>

#include "server/mapping/neighbours.h"

namespace cairn {

MapDelta count_sightings(const Map& map, KeyframeId id, GridCache& grids, std::size_t neighbours) {
  MapDelta delta = MapDelta::based_on(map);
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return delta;
  const KeyframeView view(*node, grids);
  std::vector<KeyframeId> keyframes = best_covisible(map, id, neighbours);
  keyframes.push_back(id);
  const std::vector<LandmarkId> own = landmarks_of(map, {id});
  for (const LandmarkId l : landmarks_of(map, keyframes)) {
    const Landmark& landmark = map.landmarks.at(l);
    if (landmark.reference == id) continue;
    const bool found = std::binary_search(own.begin(), own.end(), l);
    if (found || view.project(landmark)) delta.sightings.push_back({l, 1, found ? 1u : 0u});
  }
  return delta;
}

}  // namespace cairn
