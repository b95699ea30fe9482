#include "server/mapping/local_window.h"

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "server/mapping/neighbours.h"

namespace cairn {
namespace {

std::vector<KeyframeId> most(const std::map<KeyframeId, int>& counts, std::size_t limit) {
  std::vector<std::pair<int, KeyframeId>> order;
  for (const auto& [id, count] : counts) order.emplace_back(-count, id);
  std::sort(order.begin(), order.end());
  if (order.size() > limit) order.resize(limit);
  std::vector<KeyframeId> ids;
  for (const auto& [count, id] : order) ids.push_back(id);
  return ids;
}

// Centres first, newest first if there are too many; then the most covisible.
std::vector<KeyframeId> choose_moving(const Map& map, std::span<const KeyframeId> centres,
                                      const LocalWindowOptions& options) {
  std::set<KeyframeId> chosen;
  for (auto c = centres.rbegin(); c != centres.rend() && chosen.size() < options.max_free; ++c)
    if (map.keyframes.contains(*c)) chosen.insert(*c);
  std::map<KeyframeId, int> shared;
  for (const KeyframeId centre : chosen)
    for (const Covisible& c : map.keyframes.at(centre).covisible)
      if (c.shared >= options.min_shared && !chosen.contains(c.keyframe))
        shared[c.keyframe] = std::max(shared[c.keyframe], c.shared);
  for (const KeyframeId id : most(shared, options.max_free - chosen.size())) chosen.insert(id);
  return {chosen.begin(), chosen.end()};
}

KeyframeId oldest(const Map& map, const std::vector<KeyframeId>& ids) {
  return *std::min_element(ids.begin(), ids.end(), [&](KeyframeId a, KeyframeId b) {
    const auto arrival_a = map.keyframes.at(a).arrival, arrival_b = map.keyframes.at(b).arrival;
    return arrival_a != arrival_b ? arrival_a < arrival_b : a < b;
  });
}

}  // namespace

LocalWindow choose_local_window(const Map& map, std::span<const KeyframeId> centres,
                                const LocalWindowOptions& options) {
  const std::vector<KeyframeId> moving = choose_moving(map, centres, options);
  LocalWindow window;
  window.landmarks = landmarks_of(map, moving);

  std::map<KeyframeId, int> witnesses;
  for (const LandmarkId l : window.landmarks)
    for (const Observation& o : map.landmarks.at(l).observations)
      if (!std::binary_search(moving.begin(), moving.end(), o.keyframe)) ++witnesses[o.keyframe];
  window.fixed_keyframes = most(witnesses, options.max_fixed);

  for (const KeyframeId id : moving) {
    const bool root = !map.keyframes.at(id).parent.is_valid();
    (root ? window.fixed_keyframes : window.free_keyframes).push_back(id);
  }
  if (window.fixed_keyframes.empty() && !window.free_keyframes.empty()) {
    const KeyframeId held = oldest(map, window.free_keyframes);
    std::erase(window.free_keyframes, held);
    window.fixed_keyframes.push_back(held);
  }
  std::sort(window.fixed_keyframes.begin(), window.fixed_keyframes.end());
  return window;
}

}  // namespace cairn
