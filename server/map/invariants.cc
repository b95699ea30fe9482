#include "server/map/invariants.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

namespace cairn {
namespace {

std::string text(KeyframeId id) {
  return fmt::format("keyframe {:x}:{}", id.epoch, id.sequence);
}
std::string text(LandmarkId id) {
  return fmt::format("landmark {:x}:{}", id.origin, id.number);
}

using Problems = std::vector<std::string>;

void check_landmark(const Map& map, LandmarkId id, const Landmark& landmark, Problems& problems) {
  if (landmark.id != id) problems.push_back(text(id) + " stands under another name");
  if (landmark.observations.empty()) problems.push_back(text(id) + " is seen by no keyframe");
  if (!landmark.position.allFinite()) problems.push_back(text(id) + " is nowhere");
  if (map.replaced_landmarks.contains(id)) problems.push_back(text(id) + " is replaced yet there");
  bool reference_sees = false;
  std::vector<KeyframeId> observers;
  for (const Observation& o : landmark.observations) {
    observers.push_back(o.keyframe);
    reference_sees |= o.keyframe == landmark.reference;
    const KeyframeNode* node = map.keyframes.find(o.keyframe);
    if (!node || o.feature >= node->landmarks.size() || node->landmarks[o.feature] != id)
      problems.push_back(text(id) + " is seen by " + text(o.keyframe) + ", which does not know");
  }
  if (!reference_sees) problems.push_back(text(id) + " moves with a keyframe that does not see it");
  std::sort(observers.begin(), observers.end());
  if (std::adjacent_find(observers.begin(), observers.end()) != observers.end())
    problems.push_back(text(id) + " is seen twice by one keyframe");
}

void check_features(const Map& map, KeyframeId id, const KeyframeNode& node, Problems& problems) {
  if (node.landmarks.size() != node.features().size())
    problems.push_back(text(id) + " has not one landmark entry a feature");
  std::map<KeyframeId, int> shared;
  for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
    if (!node.landmarks[f].is_valid()) continue;
    const Landmark* landmark = map.landmarks.find(node.landmarks[f]);
    bool mutual = false;
    if (landmark)
      for (const Observation& o : landmark->observations) {
        mutual |= o == Observation{id, static_cast<std::uint16_t>(f)};
        if (o.keyframe != id) ++shared[o.keyframe];
      }
    if (!mutual)
      problems.push_back(
          fmt::format("{} feature {} shows a landmark that does not know", text(id), f));
  }
  std::map<KeyframeId, int> listed;
  for (const Covisible& c : node.covisible) listed[c.keyframe] = c.shared;
  if (listed != shared || listed.size() != node.covisible.size())
    problems.push_back(text(id) + " has a wrong covisible list");
  for (std::size_t i = 1; i < node.covisible.size(); ++i)
    if (!stronger(node.covisible[i - 1], node.covisible[i]))
      problems.push_back(text(id) + " has a covisible list out of order");
}

void check_tree(const Map& map, KeyframeId id, const KeyframeNode& node, Problems& problems) {
  if (!std::is_sorted(node.children.begin(), node.children.end()))
    problems.push_back(text(id) + " has children out of order");
  for (const KeyframeId child : node.children) {
    const KeyframeNode* found = map.keyframes.find(child);
    if (!found || found->parent != id)
      problems.push_back(text(id) + " has a child that does not know");
  }
  if (node.parent.is_valid()) {
    const KeyframeNode* parent = map.keyframes.find(node.parent);
    if (!parent || !std::binary_search(parent->children.begin(), parent->children.end(), id))
      problems.push_back(text(id) + " has a parent that does not know");
  }
  std::size_t steps = 0;
  for (KeyframeId up = id; up.is_valid() && steps <= map.keyframes.size(); ++steps) {
    const KeyframeNode* ancestor = map.keyframes.find(up);
    up = ancestor ? ancestor->parent : KeyframeId{};
  }
  if (steps > map.keyframes.size()) problems.push_back(text(id) + " descends from itself");
}

}  // namespace

std::vector<std::string> check_invariants(const Map& map) {
  Problems problems;
  for (const LandmarkId id : map.landmarks.sorted_keys())
    check_landmark(map, id, map.landmarks.at(id), problems);
  for (const KeyframeId id : map.keyframes.sorted_keys()) {
    const KeyframeNode& node = map.keyframes.at(id);
    check_features(map, id, node, problems);
    check_tree(map, id, node, problems);
    if (!node.map_from_camera.is_finite()) problems.push_back(text(id) + " is nowhere");
    if (map.removed_keyframes.contains(id)) problems.push_back(text(id) + " is removed yet there");
  }
  return problems;
}

}  // namespace cairn
