#include "server/publish/parts_of_run.h"

#include <algorithm>
#include <unordered_map>

namespace cairn {
namespace {

// The roots of keyframes, each way gone once.
class Roots {
 public:
  explicit Roots(const Map& map) : map_(map) {}

  // Of one that is or was in the map; else not valid.
  KeyframeId of(KeyframeId id) {
    id = map_.present(id);
    std::vector<KeyframeId> way;
    const KeyframeNode* node = map_.keyframes.find(id);
    if (!node) return {};
    while (!roots_.contains(id)) {
      way.push_back(id);
      if (!node->parent.is_valid()) break;
      id = node->parent;
      node = &map_.keyframes.at(id);
    }
    const auto known = roots_.find(id);
    const KeyframeId root = known == roots_.end() ? id : known->second;
    for (const KeyframeId step : way) roots_[step] = root;
    return root;
  }

 private:
  const Map& map_;
  std::unordered_map<KeyframeId, KeyframeId> roots_;
};

}  // namespace

std::vector<PartOfRun> parts_of_run(const Map& map, std::uint64_t epoch, std::uint32_t count) {
  Roots roots(map);
  std::vector<KeyframeId> parts;  // by their roots
  std::vector<PartOfRun> runs;
  for (std::uint32_t sequence = 0; sequence < count; ++sequence) {
    const KeyframeId root = roots.of({epoch, sequence});
    if (!root.is_valid()) continue;
    const auto known = std::find(parts.begin(), parts.end(), root);
    const auto part = static_cast<std::uint32_t>(known - parts.begin());
    if (known == parts.end()) parts.push_back(root);
    if (runs.empty())
      runs.push_back({0, part});
    else if (runs.back().part != part)
      runs.push_back({sequence, part});
  }
  return runs;
}

}  // namespace cairn
