#include "server/mapping/local_window.h"

#include <algorithm>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "server/mapping/neighbours.h"

namespace cairn {
namespace {

using Counts = std::unordered_map<KeyframeId, int>;

std::vector<KeyframeId> most(const Counts& counts, std::size_t limit) {
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
  const bool mono = std::any_of(centres.begin(), centres.end(), [&](KeyframeId id) {
    const KeyframeNode* node = map.keyframes.find(id);
    return node && node->rig().sensor == Sensor::kMono;
  });
  const std::size_t max_free = options.max_free * (mono ? options.mono_times : 1);
  std::set<KeyframeId> chosen;
  for (auto c = centres.rbegin(); c != centres.rend() && chosen.size() < max_free; ++c)
    if (map.keyframes.contains(*c)) chosen.insert(*c);
  Counts shared;
  for (const KeyframeId centre : chosen)
    for (const Covisible& c : map.keyframes.at(centre).covisible)
      if (c.shared >= options.min_shared && !chosen.contains(c.keyframe))
        shared[c.keyframe] = std::max(shared[c.keyframe], c.shared);
  for (const KeyframeId id : most(shared, max_free - chosen.size())) chosen.insert(id);
  return {chosen.begin(), chosen.end()};
}

// All that the keyframes (sorted) see, or, of those with most observations first, enough for each.
// Ascending.
std::vector<LandmarkId> choose_landmarks(const Map& map, const std::vector<KeyframeId>& keyframes,
                                         std::size_t enough) {
  std::vector<LandmarkId> all = landmarks_of(map, keyframes);
  if (all.size() <= enough) return all;
  std::vector<std::pair<std::ptrdiff_t, const Landmark*>> order;
  for (const LandmarkId id : all) {
    const Landmark& landmark = map.landmarks.at(id);
    order.emplace_back(-std::ssize(landmark.observations), &landmark);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::size_t> chosen_of(keyframes.size());
  all.clear();
  for (const auto& [observations, landmark] : order) {
    bool wanted = false;
    for (const Observation& o : landmark->observations) {
      const auto at = std::lower_bound(keyframes.begin(), keyframes.end(), o.keyframe);
      if (at == keyframes.end() || *at != o.keyframe) continue;
      wanted |= chosen_of[static_cast<std::size_t>(at - keyframes.begin())]++ < enough;
    }
    if (wanted) all.push_back(landmark->id);
  }
  std::sort(all.begin(), all.end());
  return all;
}

// How many of the landmarks each other keyframe sees.
Counts witnesses(const Map& map, const std::vector<LandmarkId>& landmarks,
                 const std::vector<KeyframeId>& moving) {
  Counts counts;
  for (const LandmarkId l : landmarks)
    for (const Observation& o : map.landmarks.at(l).observations) ++counts[o.keyframe];
  for (const KeyframeId id : moving) counts.erase(id);
  return counts;
}

bool is_root(const Map& map, KeyframeId id) {
  return !map.keyframes.at(id).parent.is_valid();
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
  window.landmarks = choose_landmarks(map, moving, options.landmarks_each);
  window.fixed_keyframes = most(witnesses(map, window.landmarks, moving), options.max_fixed);
  for (const KeyframeId id : moving)
    (is_root(map, id) ? window.fixed_keyframes : window.free_keyframes).push_back(id);
  if (window.fixed_keyframes.empty() && !window.free_keyframes.empty()) {
    const KeyframeId held = oldest(map, window.free_keyframes);
    std::erase(window.free_keyframes, held);
    window.fixed_keyframes.push_back(held);
  }
  std::sort(window.fixed_keyframes.begin(), window.fixed_keyframes.end());
  return window;
}

std::vector<KeyframeId> choose_free_keyframes(const Map& map, std::span<const KeyframeId> centres,
                                              const LocalWindowOptions& options) {
  std::vector<KeyframeId> free = choose_moving(map, centres, options);
  std::erase_if(free, [&](KeyframeId id) { return is_root(map, id); });
  return free;
}

}  // namespace cairn
