#include "server/mapping/sightings.h"

#include <algorithm>
#include <map>
#include <set>

#include "server/mapping/neighbours.h"

namespace cairn {

std::vector<MapDelta::Sighting> sightings(const Map& map, KeyframeId id, GridCache& grids,
                                          std::size_t neighbours,
                                          const std::vector<MapDelta::Fusion>& fusions,
                                          const CullOptions& options) {
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

  std::map<KeyframeId, bool> on_trial;  // by reference
  const auto counts = [&](const Landmark& landmark) {
    if (landmark.reference == id) return false;
    const auto [entry, is_new] = on_trial.try_emplace(landmark.reference);
    if (is_new) entry->second = is_on_trial(map, landmark.reference, options);
    return entry->second;
  };

  std::vector<MapDelta::Sighting> counted;
  for (const LandmarkId l : landmarks_of(map, keyframes)) {
    const Landmark& landmark = map.landmarks.at(l);
    if (!counts(landmark)) continue;
    const bool found = sees(l) || soon.contains(l);
    if (found || view.project(landmark)) counted.push_back({l, 1, found ? 1u : 0u});
  }
  return counted;
}

}  // namespace cairn
