#include "server/map/connected.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

namespace cairn {

namespace {

// The part that `id` lies in, in the order of going through it; ends once `enough` says so of a
// keyframe.
template <typename Enough>
std::vector<KeyframeId> go_through(const Map& map, KeyframeId id, Enough&& enough) {
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
    if (enough(node)) break;
    for (const Covisible& c : node.covisible) reach(c.keyframe);
    for (const KeyframeId child : node.children) reach(child);
    reach(node.parent);
    if (const auto loops = over_loops.find(here); loops != over_loops.end())
      for (const KeyframeId other : loops->second) reach(other);
  }
  return found;
}

}  // namespace

std::vector<KeyframeId> connected_keyframes(const Map& map, KeyframeId id) {
  std::vector<KeyframeId> found = go_through(map, id, [](const KeyframeNode&) { return false; });
  std::sort(found.begin(), found.end());
  return found;
}

KeyframeId root_of(const Map& map, KeyframeId id) {
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return {};
  for (; node->parent.is_valid(); node = &map.keyframes.at(id)) id = node->parent;
  return id;
}

bool is_metric(const Map& map, KeyframeId id) {
  const KeyframeNode* node = map.keyframes.find(id);
  if (node && node->rig().sensor != Sensor::kMono) return true;
  bool metric = false;
  go_through(map, id, [&](const KeyframeNode& reached) {
    return metric = reached.rig().sensor != Sensor::kMono;
  });
  return metric;
}

}  // namespace cairn
