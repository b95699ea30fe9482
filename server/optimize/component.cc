#include "server/optimize/component.h"

#include <algorithm>
#include <tuple>
#include <unordered_set>

namespace cairn {
namespace {

using Seen = std::unordered_set<KeyframeId>;

std::vector<KeyframeId> reach(const Map& map, KeyframeId start, Seen& seen) {
  std::vector<KeyframeId> found{start};
  seen.insert(start);
  const auto visit = [&](KeyframeId id) {
    if (map.keyframes.contains(id) && seen.insert(id).second) found.push_back(id);
  };
  for (std::size_t next = 0; next < found.size(); ++next) {
    const KeyframeNode& node = map.keyframes.at(found[next]);
    visit(node.parent);
    for (const KeyframeId child : node.children) visit(child);
    for (const Covisible& c : node.covisible) visit(c.keyframe);
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

std::vector<KeyframeId> component_of(const Map& map, KeyframeId of) {
  if (!map.keyframes.contains(of)) return {};
  Seen seen;
  return reach(map, of, seen);
}

std::vector<std::vector<KeyframeId>> components(const Map& map) {
  std::vector<std::vector<KeyframeId>> all;
  Seen seen;
  for (const KeyframeId id : map.keyframes.sorted_keys())
    if (!seen.contains(id)) all.push_back(reach(map, id, seen));
  return all;
}

KeyframeId oldest(const Map& map, const std::vector<KeyframeId>& keyframes) {
  const auto age = [&](KeyframeId id) {
    const KeyframeNode& node = map.keyframes.at(id);
    return std::make_tuple(node.arrival, node.keyframe->stamp_ns, id);
  };
  return *std::min_element(keyframes.begin(), keyframes.end(),
                           [&](KeyframeId a, KeyframeId b) { return age(a) < age(b); });
}

}  // namespace cairn
