// Between a map and a least-squares problem, both ways.
#include <algorithm>
#include <unordered_map>

#include "server/optimize/bundle_adjustment.h"

namespace cairn {
namespace {

struct View {
  std::uint32_t pose;
  const KeyframeNode* node;
};
using Views = std::unordered_map<KeyframeId, View>;

void add_poses(const Map& map, std::span<const KeyframeId> ids, bool fixed, BundleProblem& problem,
               Views& views) {
  for (const KeyframeId& id : ids) {
    const KeyframeNode* node = map.keyframes.find(id);
    if (!node || !node->map_from_camera.is_finite()) continue;
    const auto index = static_cast<std::uint32_t>(problem.poses.size());
    if (!views.emplace(id, View{index, node}).second) continue;
    problem.poses.push_back({id, node->map_from_camera, fixed, node->map_from_camera});
  }
}

// Fixes the oldest keyframe when none is fixed.
void hold_gauge(const Map& map, BundleProblem& problem) {
  auto& poses = problem.poses;
  if (poses.empty()) return;
  if (std::any_of(poses.begin(), poses.end(), [](const auto& pose) { return pose.fixed; })) return;
  const auto age = [&](const BundleProblem::Pose& pose) {
    return std::pair(map.keyframes.at(pose.id).keyframe->stamp_ns, pose.id);
  };
  std::min_element(poses.begin(), poses.end(), [&](const auto& a, const auto& b) {
    return age(a) < age(b);
  })->fixed = true;
}

void add_landmark(const Landmark& landmark, const Views& views, BundleProblem& problem) {
  const auto point = static_cast<std::uint32_t>(problem.points.size());
  const std::size_t first_term = problem.terms.size();
  for (const Observation& observation : landmark.observations) {
    const auto view = views.find(observation.keyframe);
    if (view == views.end()) continue;
    const KeyframeNode& node = *view->second.node;
    const Feature& feature = node.features().points[observation.feature];
    problem.terms.push_back(
        {view->second.pose, point, observation, Reprojection(*node.keyframe, feature), true});
  }
  const auto own = problem.terms.begin() + static_cast<std::ptrdiff_t>(first_term);
  if (problem.terms.size() - first_term >= 2) {
    problem.points.push_back({landmark.id, landmark.position});
    std::sort(own, problem.terms.end(),
              [](const auto& a, const auto& b) { return a.pose < b.pose; });
    return;
  }
  if (problem.terms.size() > first_term && landmark.observations.size() == 1) {
    const BundleProblem::Pose& pose = problem.poses[problem.terms.back().pose];
    if (!pose.fixed)
      problem.followers.push_back(
          {problem.terms.back().pose, landmark.id, pose.initial.inverse() * landmark.position});
  }
  problem.terms.erase(own, problem.terms.end());
}

}  // namespace

BundleProblem extract_bundle(const Map& map, std::span<const KeyframeId> free_keyframes,
                             std::span<const KeyframeId> fixed_keyframes,
                             std::span<const LandmarkId> landmarks) {
  BundleProblem problem;
  Views views;
  problem.poses.reserve(free_keyframes.size() + fixed_keyframes.size());
  views.reserve(free_keyframes.size() + fixed_keyframes.size());
  add_poses(map, free_keyframes, false, problem, views);
  add_poses(map, fixed_keyframes, true, problem, views);
  hold_gauge(map, problem);

  problem.points.reserve(landmarks.size());
  problem.terms.reserve(4 * landmarks.size());
  for (const LandmarkId& id : landmarks) {
    const Landmark* landmark = map.landmarks.find(id);
    if (landmark && landmark->position.allFinite()) add_landmark(*landmark, views, problem);
  }
  return problem;
}

MapDelta bundle_delta(const Map& map, const BundleProblem& problem) {
  MapDelta delta;
  delta.base_revision = map.revision;
  delta.base_merge_epoch = map.merge_epoch;
  for (const auto& pose : problem.poses)
    if (!pose.fixed) delta.poses.push_back({pose.id, pose.initial, pose.map_from_camera});

  std::vector<int> kept(problem.points.size(), 0);
  for (const auto& term : problem.terms) {
    if (term.active)
      ++kept[term.point];
    else
      delta.removed_observations.push_back({problem.points[term.point].id, term.observation});
  }
  for (std::size_t i = 0; i < problem.points.size(); ++i)
    if (kept[i] >= 2) delta.positions.push_back({problem.points[i].id, problem.points[i].position});
  for (const auto& follower : problem.followers)
    delta.positions.push_back(
        {follower.id, problem.poses[follower.pose].map_from_camera * follower.position_in_camera});
  return delta;
}

}  // namespace cairn
