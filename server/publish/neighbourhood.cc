#include "server/publish/neighbourhood.h"

#include <algorithm>
#include <unordered_set>

namespace cairn {
namespace {

// Of the second order, only the strongest few of each are asked: they reach far enough ahead.
constexpr std::size_t kSecondOrderEach = 5;

}  // namespace

std::vector<const KeyframeNode*> neighbourhood(const Map& map, KeyframeId centre,
                                               std::size_t limit) {
  std::vector<const KeyframeNode*> found;
  std::unordered_set<KeyframeId> seen;
  const auto add = [&](KeyframeId id) {
    const KeyframeNode* node = map.keyframes.find(id);
    if (node && found.size() < limit && seen.insert(id).second) found.push_back(node);
  };
  add(centre);
  if (found.empty()) return found;
  for (const Covisible& covisible : found.front()->covisible) add(covisible.keyframe);
  const std::size_t first_order = found.size();
  for (std::size_t i = 1; i < first_order && found.size() < limit; ++i) {
    const auto& further = found[i]->covisible;
    for (std::size_t j = 0; j < std::min(kSecondOrderEach, further.size()); ++j)
      add(further[j].keyframe);
  }
  return found;
}

}  // namespace cairn
