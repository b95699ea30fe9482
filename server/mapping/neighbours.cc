#include "server/mapping/neighbours.h"

#include <algorithm>

namespace cairn {

std::vector<KeyframeId> best_covisible(const Map& map, KeyframeId id, std::size_t count) {
  const KeyframeNode& node = map.keyframes.at(id);
  std::vector<KeyframeId> best;
  for (std::size_t i = 0; i < std::min(count, node.covisible.size()); ++i)
    best.push_back(node.covisible[i].keyframe);
  if (node.parent.is_valid() && std::find(best.begin(), best.end(), node.parent) == best.end())
    best.push_back(node.parent);
  return best;
}

std::vector<KeyframeId> neighbourhood(const Map& map, KeyframeId id, std::size_t first,
                                      std::size_t second, std::size_t limit) {
  std::vector<KeyframeId> all = best_covisible(map, id, first);
  const std::size_t direct = all.size();
  for (std::size_t i = 0; i < direct; ++i)
    for (const KeyframeId further : best_covisible(map, all[i], second))
      if (all.size() < limit && further != id &&
          std::find(all.begin(), all.end(), further) == all.end())
        all.push_back(further);
  return all;
}

std::vector<LandmarkId> landmarks_of(const Map& map, const std::vector<KeyframeId>& keyframes) {
  std::vector<LandmarkId> all;
  for (const KeyframeId id : keyframes)
    for (const LandmarkId landmark : map.keyframes.at(id).landmarks)
      if (landmark.is_valid()) all.push_back(landmark);
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

}  // namespace cairn
