#include "server/map/connected.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

namespace cairn {

std::vector<KeyframeId> connected_keyframes(const Map& map, KeyframeId id) {
  if (!map.keyframes.contains(id)) return {};
  std::unordered_map<KeyframeId, std::vector<KeyframeId>> over_loops;
  for (const LoopEdge& edge : map.loops) {
    over_loops[edge.query].push_back(edge.candidate);
    over_loops[edge.candidate].push_back(edge.query);
  }
  std::vector<KeyframeId> found{id};
  std::unordered_set<KeyframeId> seen{id};
  const auto reach = [&](KeyframeId next) {
    if (next.is_valid() && map.keyframes.contains(next) && seen.insert(next).second)
      found.push_back(next);
  };
  for (std::size_t i = 0; i < found.size(); ++i) {
    const KeyframeId here = found[i];
    const KeyframeNode& node = map.keyframes.at(here);
    for (const Covisible& c : node.covisible) reach(c.keyframe);
    for (const KeyframeId child : node.children) reach(child);
    reach(node.parent);
    if (const auto loops = over_loops.find(here); loops != over_loops.end())
      for (const KeyframeId other : loops->second) reach(other);
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace cairn
