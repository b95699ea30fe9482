#include <algorithm>
#include <map>
#include <set>

#include "server/map/apply.h"
#include "server/map/map_editor.h"

namespace cairn {
namespace {

bool make_landmark(Map& map, MapEditor& editor, const MapDelta::NewLandmark& made) {
  const LandmarkId id{LandmarkId::kServer, map.next_landmark};
  std::size_t next = 0;
  while (next < made.observations.size() &&
         !editor.insert_landmark(id, made.position, made.observations[next]))
    ++next;
  if (next == made.observations.size()) return false;
  std::size_t seen = 1;
  for (++next; next < made.observations.size(); ++next)
    seen += editor.add_observation(id, made.observations[next]) ? 1 : 0;
  // A triangulated point that lost all but one of its rays has lost its reason.
  if (seen < std::min<std::size_t>(2, made.observations.size())) {
    editor.remove_landmark(id);
    return false;
  }
  ++map.next_landmark;
  return true;
}

void change_observations(Map& map, MapEditor& editor, const MapDelta& delta, DeltaSummary& s) {
  for (const LandmarkId id : delta.removed_landmarks)
    ++(editor.remove_landmark(id) ? s.landmarks_removed : s.dropped);
  for (const auto& made : delta.new_landmarks)
    ++(make_landmark(map, editor, made) ? s.landmarks_made : s.dropped);
  for (const auto& [landmark, observation] : delta.new_observations)
    ++(editor.add_observation(map.resolve(landmark), observation) ? s.observations_added
                                                                  : s.dropped);
  for (const auto& [from, into] : delta.fusions) ++(editor.fuse(from, into) ? s.fused : s.dropped);
  for (const auto& [landmark, observation] : delta.removed_observations)
    ++(editor.remove_observation(map.resolve(landmark), observation) ? s.observations_removed
                                                                     : s.dropped);
}

// What the map has never had does not count.
void count_mapped(Map& map, KeyframeId id) {
  if (!map.keyframes.contains(id) && !map.removed_keyframes.contains(id)) return;
  if (id.sequence < map.mapped_of(id.epoch)) return;
  map.mapped_keyframes.insert(id.epoch, id.sequence + 1);
}

// Keyframes that came after `revision`, in order of their arrival.
std::vector<KeyframeId> arrived_since(const Map& map, std::uint64_t revision) {
  std::vector<std::pair<std::uint64_t, KeyframeId>> found;
  map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
    if (node.arrival > revision) found.emplace_back(node.arrival, id);
  });
  std::sort(found.begin(), found.end());
  std::vector<KeyframeId> ids;
  for (const auto& [arrival, id] : found) ids.push_back(id);
  return ids;
}

// By how much each keyframe moves: new_map_from_old_map.
using Moves = std::map<KeyframeId, Sim3>;

void carry_landmarks(Map& map, MapEditor& editor, std::uint64_t base_revision, const Moves& moves,
                     DeltaSummary& s) {
  for (const auto& [id, move] : moves) {
    const std::vector<LandmarkId> landmarks = map.keyframes.at(id).landmarks;
    for (const LandmarkId l : landmarks) {
      const Landmark* landmark = map.landmarks.find(l);
      if (!landmark || landmark->reference != id) continue;
      // Those of this delta itself (arrival == revision) are where they should be.
      if (landmark->arrival <= base_revision || landmark->arrival == map.revision) continue;
      editor.set_position(l, move * landmark->position);
      ++s.carried;
    }
  }
}

void change_poses(Map& map, MapEditor& editor, const MapDelta& delta, DeltaSummary& s) {
  Moves moves;
  for (const auto& change : delta.poses) {
    const KeyframeNode* node = map.keyframes.find(change.keyframe);
    // Relative to the present pose, not the snapshot's: if another delta has moved it since, what
    // hangs on it has moved along already.
    if (!node) {
      ++s.dropped;
      continue;
    }
    Sim3 pose = change.map_from_camera;
    pose.scale = change.scale * node->unit;
    moves[change.keyframe] = pose * node->scaled_pose().inverse();
    s.poses_changed += editor.set_pose(change.keyframe, pose) ? 1 : 0;
  }
  if (moves.empty()) return;
  for (const KeyframeId id : arrived_since(map, delta.base_revision)) {
    const KeyframeNode& node = map.keyframes.at(id);
    auto anchor = moves.find(node.keyframe->reference);
    if (anchor == moves.end()) anchor = moves.find(node.parent);
    if (anchor == moves.end() || moves.contains(id)) continue;
    const Sim3 move = anchor->second;
    editor.set_pose(id, move * node.scaled_pose());
    moves[id] = move;
    ++s.carried;
  }
  carry_landmarks(map, editor, delta.base_revision, moves, s);
}

// The part that moves hangs on the other one from now on: it is held by it like any other keyframe,
// and no longer by a root of its own.
void join_parts(MapEditor& editor, const LoopClosure& closure) {
  const LoopEdge& edge = closure.edge;
  const auto& poses = closure.correction.poses;
  const bool query_moves = std::any_of(poses.begin(), poses.end(), [&](const auto& change) {
    return change.keyframe == edge.query;
  });
  if (query_moves)
    editor.graft_tree(edge.query, edge.candidate);
  else
    editor.graft_tree(edge.candidate, edge.query);
}

DeltaSummary apply(Map& map, MapEditor& editor, const MapDelta& delta) {
  DeltaSummary s;
  change_observations(map, editor, delta, s);
  change_poses(map, editor, delta, s);
  for (const auto& [landmark, position] : delta.positions)
    ++(editor.set_position(landmark, position) ? s.landmarks_moved : s.dropped);
  for (const auto& [id, visible, found] : delta.sightings) {
    Landmark* landmark = map.landmarks.edit(id);
    if (!landmark) continue;
    landmark->visible += visible;
    landmark->found += found;
  }
  for (const KeyframeId id : delta.removed_keyframes)
    ++(editor.remove_keyframe(id) ? s.keyframes_removed : s.dropped);
  for (const KeyframeId id : delta.mapped_keyframes) count_mapped(map, id);
  return s;
}

}  // namespace

DeltaSummary apply_delta(Map& map, const MapDelta& delta) {
  DeltaSummary s;
  s.is_void = delta.base_merge_epoch != map.merge_epoch;
  if (s.is_void) return s;
  MapEditor editor(map);
  return apply(map, editor, delta);
}

DeltaSummary apply_loop(Map& map, const LoopClosure& closure) {
  const LoopEdge& edge = closure.edge;
  DeltaSummary s;
  s.is_void = !map.keyframes.contains(edge.query) || !map.keyframes.contains(edge.candidate) ||
              closure.correction.base_merge_epoch != map.merge_epoch;
  if (s.is_void) return s;
  MapEditor editor(map);
  s = apply(map, editor, closure.correction);
  if (edge.merges) join_parts(editor, closure);
  map.loops.push_back(edge);
  ++map.merge_epoch;
  return s;
}

bool remove_keyframe(Map& map, KeyframeId id) {
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node || !node->parent.is_valid()) return false;
  MapEditor editor(map);
  return editor.remove_keyframe(id);
}

}  // namespace cairn
