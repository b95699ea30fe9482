#include "server/optimize/global_ba.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

#include "common/util/clock.h"
#include "server/optimize/component.h"

namespace cairn {
namespace {

BundleProblem extract_all(const Map& map, const std::vector<std::vector<KeyframeId>>& parts) {
  std::vector<KeyframeId> free, fixed;
  std::vector<LandmarkId> landmarks;
  for (const auto& part : parts) {
    const KeyframeId held = oldest(map, part);
    fixed.push_back(held);
    for (const KeyframeId id : part) {
      if (id != held) free.push_back(id);
      for (const LandmarkId l : map.keyframes.at(id).landmarks)
        if (l.is_valid()) landmarks.push_back(l);
    }
  }
  std::sort(landmarks.begin(), landmarks.end());
  landmarks.erase(std::unique(landmarks.begin(), landmarks.end()), landmarks.end());
  return extract_bundle(map, free, fixed, landmarks);
}

// Landmarks without a position of their own in the delta go where their reference keyframe goes.
void carry_landmarks(const Map& map, MapDelta& delta) {
  std::unordered_set<LandmarkId> placed;
  placed.reserve(delta.positions.size());
  for (const auto& change : delta.positions) placed.insert(change.landmark);
  for (const auto& change : delta.poses) {
    const Rigid3 move = change.map_from_camera * change.old_map_from_camera.inverse();
    for (const LandmarkId id : map.keyframes.at(change.keyframe).landmarks) {
      const Landmark* landmark = id.is_valid() ? map.landmarks.find(id) : nullptr;
      if (!landmark || landmark->reference != change.keyframe || placed.contains(id)) continue;
      delta.positions.push_back({id, move * landmark->position});
    }
  }
}

}  // namespace

MapDelta solve_global_ba(const Map& snapshot, KeyframeId part_of, const GlobalBaOptions& options,
                         GlobalBaSummary* summary, std::stop_token stop) {
  const Stopwatch watch;
  std::vector<std::vector<KeyframeId>> parts;
  if (!part_of.is_valid())
    parts = components(snapshot);
  else if (auto part = component_of(snapshot, part_of); !part.empty())
    parts.push_back(std::move(part));
  BundleProblem problem = extract_all(snapshot, parts);
  const double extract_ms = watch.milliseconds();
  BundleSummary result = solve_bundle(problem, options.bundle, std::move(stop));
  result.extract_ms = extract_ms;
  if (summary) *summary = result;
  if (!result.usable || result.stopped || result.observations == 0 || result.keyframes == 0)
    return MapDelta::based_on(snapshot);
  MapDelta delta = bundle_delta(snapshot, problem);
  carry_landmarks(snapshot, delta);
  return delta;
}

}  // namespace cairn
