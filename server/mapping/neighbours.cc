#include "server/mapping/neighbours.h"

#include <algorithm>
#include <map>

#include "server/map/landmark_set.h"
#include "server/mapping/keyframe_view.h"

namespace cairn {
namespace {

// Of its landmarks, that a keyframe must show beyond those that it is known to share.
constexpr double kLeastUnknown = 0.1;

// Enough of them to tell how much two keyframes have in common.
std::vector<const Landmark*> landmarks_sampled(const Map& map, KeyframeId id) {
  constexpr std::size_t kMost = 32;
  const std::vector<LandmarkId> own = landmarks_of(map, {id});
  const std::size_t step = own.size() / kMost + 1;
  std::vector<const Landmark*> sample;
  for (std::size_t i = 0; i < own.size(); i += step) sample.push_back(map.landmarks.find(own[i]));
  return sample;
}

double share_in_view(const KeyframeNode& node, const std::vector<const Landmark*>& landmarks) {
  const Rigid3 camera_from_map = node.map_from_camera.inverse();
  const auto shown = std::count_if(landmarks.begin(), landmarks.end(), [&](const Landmark* l) {
    return can_show(node, camera_from_map, *l).has_value();
  });
  return static_cast<double>(shown) /
         static_cast<double>(std::max<std::size_t>(landmarks.size(), 1));
}

// What is covisible with `id` or with one of `near`, and the share of the landmarks of `id` that it
// sees: of those of second order none is known.
std::map<KeyframeId, double> within_two_steps(const Map& map, KeyframeId id,
                                              const std::vector<KeyframeId>& near) {
  std::map<KeyframeId, double> found;
  for (const KeyframeId by : near)
    for (const Covisible& c : map.keyframes.at(by).covisible) found[c.keyframe] = 0;
  const double own = static_cast<double>(landmarks_of(map, {id}).size());
  for (const Covisible& c : map.keyframes.at(id).covisible) found[c.keyframe] = c.shared / own;
  found.erase(id);
  return found;
}

}  // namespace

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
                                      std::size_t limit) {
  std::vector<KeyframeId> all = best_covisible(map, id, first);
  std::vector<std::pair<double, KeyframeId>> strangers;
  const std::vector<const Landmark*> sample = landmarks_sampled(map, id);
  for (const auto& [other, shared] : within_two_steps(map, id, all)) {
    if (std::find(all.begin(), all.end(), other) != all.end()) continue;
    const double unknown = share_in_view(map.keyframes.at(other), sample) - shared;
    if (unknown > kLeastUnknown) strangers.emplace_back(-unknown, other);
  }
  std::sort(strangers.begin(), strangers.end());
  for (const auto& [unknown, other] : strangers)
    if (all.size() < limit) all.push_back(other);
  return all;
}

std::vector<LandmarkId> landmarks_of(const Map& map, const std::vector<KeyframeId>& keyframes) {
  std::vector<LandmarkId> all;
  LandmarkSet seen(1000);
  for (const KeyframeId id : keyframes)
    for (const LandmarkId landmark : map.keyframes.at(id).landmarks)
      if (landmark.is_valid() && seen.insert(landmark)) all.push_back(landmark);
  std::sort(all.begin(), all.end());
  return all;
}

}  // namespace cairn
