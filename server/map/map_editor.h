// The one place that changes a map: small operations that keep its invariants, for the functions of
// apply.h. One editor is one event: it takes the map to its next revision.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "server/map/covisibility_changes.h"
#include "server/map/map.h"

namespace cairn {

// Not thread-safe. Covisibility and what follows from a landmark's observations are brought up to
// date by finish(), once for everything touched; in between they may lag behind.
class MapEditor {
 public:
  explicit MapEditor(Map& map);
  ~MapEditor() { finish(); }
  MapEditor(const MapEditor&) = delete;
  MapEditor& operator=(const MapEditor&) = delete;

  // The keyframe comes without landmarks and without a place in the spanning tree. The pose with
  // the size of the keyframe's own unit, here and below.
  void insert_keyframe(KeyframePtr keyframe, const Sim3& map_from_camera);
  // Its parent becomes the most covisible keyframe; else `fallback`, where that is in the map; else
  // it is a root. Call once the observations are in.
  void join_tree(KeyframeId id, KeyframeId fallback);
  // The tree that `id` is in becomes a branch of that of `parent`: `id` hangs on `parent`, and the
  // former root, step by step, on `id`. Both are in the map. Nothing happens within one tree.
  void graft_tree(KeyframeId id, KeyframeId parent);
  // False for roots and unknown ones. See apply.h.
  bool remove_keyframe(KeyframeId id);

  // False, and nothing changed, where one of both is gone, the feature shows another landmark or
  // the keyframe sees the landmark already.
  bool add_observation(LandmarkId landmark, const Observation& observation);
  // A landmark vanishes with its last observation.
  bool remove_observation(LandmarkId landmark, const Observation& observation);

  // Makes the landmark with its first observation; false where the feature is taken or gone, or the
  // name in use.
  bool insert_landmark(LandmarkId id, const Eigen::Vector3d& position, const Observation& first);
  bool remove_landmark(LandmarkId id);
  // Ids are resolved first. False when either is gone or both are the same.
  bool fuse(LandmarkId from, LandmarkId into);

  bool set_pose(KeyframeId id, const Sim3& map_from_camera);
  bool set_position(LandmarkId id, const Eigen::Vector3d& position);

  void finish();

 private:
  enum class Touch : std::uint8_t { kPosition, kObservations };

  bool is_free(const Observation& observation) const;
  void attach(Landmark& landmark, const Observation& observation);
  void touch(LandmarkId id, Touch what) { touched_.emplace_back(id, what); }
  void update_covisibility();
  void set_parent(KeyframeId child, KeyframeId parent);
  KeyframeId new_parent(const KeyframeNode& child, KeyframeId removed) const;
  void move_loops(KeyframeId id, const FormerKeyframe& former);
  bool descends_from(KeyframeId id, KeyframeId ancestor) const;

  Map& map_;
  std::vector<std::pair<LandmarkId, Touch>> touched_;  // those of landmarks touched twice, twice
  CovisibilityChanges covisibility_;
};

}  // namespace cairn
