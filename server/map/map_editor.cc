#include "server/map/map_editor.h"

#include <algorithm>
#include <functional>

#include "server/map/connected.h"
#include "server/map/refresh.h"

namespace cairn {
namespace {

bool sees(const Landmark& landmark, KeyframeId keyframe) {
  return std::any_of(landmark.observations.begin(), landmark.observations.end(),
                     [&](const Observation& o) { return o.keyframe == keyframe; });
}

// Strongest first, before and after. `changes` ascend by keyframe; they are few, or most of the
// list.
void change_shared(std::vector<Covisible>& list, std::vector<std::pair<KeyframeId, int>>& changes) {
  std::size_t left = changes.size(), first = list.size();
  bool has_gone = false;
  for (std::size_t i = 0; i < list.size() && left > 0; ++i) {
    const auto change =
        std::lower_bound(changes.begin(), changes.end(), list[i].keyframe,
                         [](const auto& entry, KeyframeId id) { return entry.first < id; });
    if (change == changes.end() || change->first != list[i].keyframe) continue;
    list[i].shared += std::exchange(change->second, 0);
    has_gone |= list[i].shared == 0;
    first = std::min(first, i);
    --left;
  }
  if (left > 0)
    for (const auto& [other, shared] : changes)
      if (shared != 0) list.push_back({other, shared});
  // Few have changed, and by little: each goes to its place among those before it.
  for (auto it = list.begin() + static_cast<std::ptrdiff_t>(first); it != list.end(); ++it) {
    if (it == list.begin() || !stronger(*it, *(it - 1))) continue;
    std::rotate(std::upper_bound(list.begin(), it, *it, stronger), it, it + 1);
  }
  while (has_gone && !list.empty() && list.back().shared == 0) list.pop_back();
}

// Of many views, one more or less hardly changes which is the most typical.
bool is_worth_a_descriptor(const Landmark& landmark) {
  constexpr std::size_t kFew = 8, kEvery = 4;
  const std::size_t views = landmark.observations.size();
  return views <= kFew || views % kEvery == 0;
}

}  // namespace

MapEditor::MapEditor(Map& map) : map_(map) {
  ++map_.revision;
}

void MapEditor::insert_keyframe(KeyframePtr keyframe, const Sim3& map_from_camera) {
  const KeyframeId id = keyframe->id;
  KeyframeNode node;
  node.map_from_camera = map_from_camera.pose();
  node.unit = map_from_camera.scale;
  node.landmarks.edit().resize(keyframe->features.size());
  node.arrival = node.revision = map_.revision;
  node.keyframe = std::move(keyframe);
  map_.keyframes.insert(id, std::move(node));
  ++map_.keyframes_ever;
}

void MapEditor::join_tree(KeyframeId id, KeyframeId fallback) {
  update_covisibility();
  const KeyframeNode* node = map_.keyframes.find(id);
  if (!node) return;
  if (!node->covisible.empty())
    set_parent(id, node->covisible.front().keyframe);
  else if (fallback != id && map_.keyframes.contains(fallback))
    set_parent(id, fallback);
}

void MapEditor::graft_tree(KeyframeId id, KeyframeId parent) {
  if (root_of(map_, id) == root_of(map_, parent)) return;
  while (id.is_valid()) {
    const KeyframeId former = map_.keyframes.at(id).parent;
    set_parent(id, parent);
    parent = id;
    id = former;
  }
}

bool MapEditor::remove_keyframe(KeyframeId id) {
  const KeyframeNode* node = map_.keyframes.find(id);
  if (!node || !node->parent.is_valid()) return false;
  const KeyframeId parent = node->parent;
  const Sim3 map_from_parent = map_.keyframes.at(parent).scaled_pose();
  const FormerKeyframe former{parent, map_from_parent.inverse() * node->scaled_pose(),
                              map_.keyframes_ever};

  // While it still has its covisible keyframes: they are what its children are handed on to.
  const std::vector<KeyframeId> children = node->children;
  for (KeyframeId child : children) set_parent(child, new_parent(map_.keyframes.at(child), id));

  const std::vector<LandmarkId> landmarks = map_.keyframes.at(id).landmarks;
  for (std::size_t f = 0; f < landmarks.size(); ++f) {
    if (!landmarks[f].is_valid()) continue;
    remove_observation(landmarks[f], {id, static_cast<std::uint16_t>(f)});
    const Landmark* left = map_.landmarks.find(landmarks[f]);
    if (left && left->observations.size() == 1) remove_landmark(landmarks[f]);
  }
  update_covisibility();

  auto& siblings = map_.keyframes.edit(parent)->children;
  siblings.erase(std::find(siblings.begin(), siblings.end(), id));
  map_.keyframes.erase(id);
  map_.removed_keyframes.insert(id, former);
  move_loops(id, former);
  return true;
}

// Loops hold on to the keyframe that takes the place of a culled one.
void MapEditor::move_loops(KeyframeId id, const FormerKeyframe& former) {
  const Sim3& anchor_from_camera = former.anchor_from_camera;
  for (LoopEdge& edge : map_.loops) {
    if (edge.query == id) {
      edge.candidate_from_query = edge.candidate_from_query * anchor_from_camera.inverse();
      edge.query = former.anchor;
    }
    if (edge.candidate == id) {
      edge.candidate_from_query = anchor_from_camera * edge.candidate_from_query;
      edge.candidate = former.anchor;
    }
  }
}

bool MapEditor::is_free(const Observation& o) const {
  const KeyframeNode* node = map_.keyframes.find(o.keyframe);
  return node && o.feature < node->landmarks.size() && !node->landmarks[o.feature].is_valid();
}

bool MapEditor::add_observation(LandmarkId id, const Observation& observation) {
  const Landmark* landmark = map_.landmarks.find(id);
  if (!landmark || !is_free(observation) || sees(*landmark, observation.keyframe)) return false;
  attach(*map_.landmarks.edit(id), observation);
  return true;
}

void MapEditor::attach(Landmark& landmark, const Observation& observation) {
  covisibility_.add(observation.keyframe, landmark.observations, +1);
  landmark.observations.push_back(observation);
  map_.keyframes.edit(observation.keyframe)->landmarks.edit()[observation.feature] = landmark.id;
  touch(landmark.id, Touch::kObservations);
  if (covisibility_.is_full()) update_covisibility();
}

bool MapEditor::remove_observation(LandmarkId id, const Observation& observation) {
  const Landmark* found = map_.landmarks.find(id);
  if (!found) return false;
  const auto& all = found->observations;
  const auto at = std::find(all.begin(), all.end(), observation) - all.begin();
  if (at == std::ssize(all)) return false;

  Landmark& landmark = *map_.landmarks.edit(id);
  landmark.observations.erase(landmark.observations.begin() + at);
  map_.keyframes.edit(observation.keyframe)->landmarks.edit()[observation.feature] = LandmarkId{};
  covisibility_.add(observation.keyframe, landmark.observations, -1);
  if (covisibility_.is_full()) update_covisibility();
  if (landmark.observations.empty()) {
    map_.landmarks.erase(id);
    return true;
  }
  if (landmark.reference == observation.keyframe)
    landmark.reference = landmark.observations.front().keyframe;
  touch(id, Touch::kObservations);
  return true;
}

bool MapEditor::insert_landmark(LandmarkId id, const Eigen::Vector3d& position,
                                const Observation& first) {
  if (!id.is_valid() || map_.landmarks.contains(id) || !is_free(first)) return false;
  Landmark landmark;
  landmark.id = id;
  landmark.position = position;
  landmark.reference = first.keyframe;
  landmark.birth = map_.keyframes_ever;
  landmark.arrival = map_.revision;
  map_.replaced_landmarks.erase(id);
  attach(map_.landmarks.insert(id, std::move(landmark)), first);
  return true;
}

bool MapEditor::remove_landmark(LandmarkId id) {
  const Landmark* landmark = map_.landmarks.find(id);
  if (!landmark) return false;
  const std::vector<Observation> observations = landmark->observations;
  for (const Observation& o : observations) remove_observation(id, o);
  return true;
}

bool MapEditor::fuse(LandmarkId from, LandmarkId into) {
  from = map_.resolve(from);
  into = map_.resolve(into);
  if (!from.is_valid() || !into.is_valid() || from == into) return false;
  const Landmark old = map_.landmarks.at(from);
  remove_landmark(from);
  for (const Observation& o : old.observations) add_observation(into, o);
  Landmark& kept = *map_.landmarks.edit(into);
  kept.found += old.found;
  kept.visible += old.visible;
  map_.replaced_landmarks.insert(from, {into, map_.keyframes_ever});
  return true;
}

bool MapEditor::set_pose(KeyframeId id, const Sim3& map_from_camera) {
  KeyframeNode* node = map_.keyframes.edit(id);
  if (!node) return false;
  node->map_from_camera = map_from_camera.pose();
  node->unit = map_from_camera.scale;
  node->revision = map_.revision;
  return true;
}

bool MapEditor::set_position(LandmarkId id, const Eigen::Vector3d& position) {
  Landmark* landmark = map_.landmarks.edit(id);
  if (!landmark) return false;
  landmark->position = position;
  touch(id, Touch::kPosition);
  return true;
}

void MapEditor::finish() {
  update_covisibility();
  // In order, so that the same event does the same on every run; of a landmark the strongest first.
  std::sort(touched_.begin(), touched_.end(), std::greater());
  LandmarkId last;
  for (const auto& [id, what] : touched_) {
    if (std::exchange(last, id) == id) continue;
    Landmark* landmark = map_.landmarks.edit(id);
    if (!landmark) continue;
    landmark->revision = map_.revision;
    if (what == Touch::kObservations && is_worth_a_descriptor(*landmark))
      refresh_descriptor(map_, *landmark);
    refresh_geometry(map_, *landmark);
  }
  touched_.clear();
}

void MapEditor::update_covisibility() {
  covisibility_.take([&](KeyframeId id, auto& changes) {
    change_shared(map_.keyframes.edit(id)->covisible.edit(), changes);
  });
}

void MapEditor::set_parent(KeyframeId child, KeyframeId parent) {
  const KeyframeId former_parent = map_.keyframes.at(child).parent;
  if (KeyframeNode* former = map_.keyframes.edit(former_parent))
    std::erase(former->children, child);
  map_.keyframes.edit(child)->parent = parent;
  auto& children = map_.keyframes.edit(parent)->children;
  children.insert(std::lower_bound(children.begin(), children.end(), child), child);
}

// The most covisible keyframe that is no descendant of the child; else the removed one's parent.
KeyframeId MapEditor::new_parent(const KeyframeNode& child, KeyframeId removed) const {
  for (const Covisible& c : child.covisible)
    if (c.keyframe != removed && !descends_from(c.keyframe, child.keyframe->id)) return c.keyframe;
  return map_.keyframes.at(removed).parent;
}

bool MapEditor::descends_from(KeyframeId id, KeyframeId ancestor) const {
  for (; id.is_valid(); id = map_.keyframes.at(id).parent)
    if (id == ancestor) return true;
  return false;
}

}  // namespace cairn
