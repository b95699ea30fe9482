#include "server/mapping/sightings.h"

#include <algorithm>
#include <set>

#include "server/mapping/neighbours.h"

namespace cairn {

std::vector<MapDelta::Sighting> sightings(const Map& map, KeyframeId id, GridCache& grids,
                                          std::size_t neighbours,
                                          const std::vector<MapDelta::Fusion>& fusions) {
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return {};
  const KeyframeView view(*node, grids);
  std::vector<KeyframeId> keyframes = best_covisible(map, id, neighbours);
  keyframes.push_back(id);
  const std::vector<LandmarkId> seen = landmarks_of(map, {id});
  const auto sees = [&](LandmarkId l) { return std::binary_search(seen.begin(), seen.end(), l); };
  std::set<LandmarkId> soon;
  for (const auto& [from, into] : fusions)
    if (sees(from) || sees(into)) soon.insert({from, into});

  std::vector<MapDelta::Sighting> counted;
  for (const LandmarkId l : landmarks_of(map, keyframes)) {
    const Landmark& landmark = map.landmarks.at(l);
    if (landmark.reference == id) continue;
    const bool found = sees(l) || soon.contains(l);
    if (found || view.project(landmark)) counted.push_back({l, 1, found ? 1u : 0u});
  }
  return counted;
}

}  // namespace cairn
