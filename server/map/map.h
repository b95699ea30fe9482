// The map: keyframe poses, landmarks, and who sees what. A plain value; copying it costs
// microseconds (see cow_table.h), and a copy behind a shared pointer to const is a Snapshot.
//
// Only a MapWriter changes a map that others see (map_writer.h), by way of the functions in
// apply.h, which keep the invariants below. Everything else works on snapshots and sends back a
// MapDelta.
//
// Invariants
// - keyframe.landmarks[f] == l  <=>  landmark l has the observation (keyframe, f)
// - every landmark has at least one observation
// - covisible lists are symmetric, with weight = number of shared landmarks
// - every keyframe but a root has a parent that is in the map; parents make no cycle
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/geometry/sim3.h"
#include "common/model/ids.h"
#include "common/model/keyframe.h"
#include "common/model/map_update.h"
#include "server/map/cow_table.h"
#include "server/map/cow_vector.h"

namespace cairn {

struct Observation {
  KeyframeId keyframe;
  std::uint16_t feature = 0;

  auto operator<=>(const Observation&) const = default;
};

struct Covisible {
  KeyframeId keyframe;
  int shared = 0;  // landmarks that both see
};
// The order of KeyframeNode::covisible.
inline bool stronger(const Covisible& a, const Covisible& b) {
  return a.shared != b.shared ? a.shared > b.shared : a.keyframe < b.keyframe;
}

// A keyframe's estimate beside its immutable measurement.
struct KeyframeNode {
  KeyframePtr keyframe;
  Rigid3 map_from_camera;
  // How large the keyframe's own unit is in the map's (Keyframe): 1 unless loops or merges have
  // changed the scale here since its client made it.
  double unit = 1;
  CowVector<LandmarkId> landmarks;   // one a feature; not valid where the feature shows none
  CowVector<Covisible> covisible;    // strongest first, ties by id
  KeyframeId parent;                 // spanning tree; not valid for a root
  std::vector<KeyframeId> children;  // ascending
  std::uint64_t arrival = 0;         // revision of the map with which it came
  std::uint64_t revision = 0;        // of the map when the pose changed last

  // Takes what the client measured in this camera, in the keyframe's own unit, to map.
  Sim3 scaled_pose() const { return {map_from_camera.rotation, map_from_camera.translation, unit}; }
  const Rig& rig() const { return *keyframe->rig; }
  const Features& features() const { return keyframe->features; }
};

struct Landmark {
  LandmarkId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map
  std::vector<Observation> observations;               // in order of their arrival
  KeyframeId reference;                                // the keyframe that it moves with

  // Derived from the observations by refresh_landmark() in apply.h.
  Descriptor descriptor{};  // the observed one with the least median distance to the others
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  // mean direction towards the cameras, in map
  float min_distance = 0, max_distance = 0;          // metres, see LandmarkState

  // Quality: while it was on trial (server/mapping/cull.h), in how many keyframes it should have
  // been found and in how many it was; and how many keyframes the map had been given when it was
  // made.
  std::uint32_t visible = 1, found = 1;
  std::uint64_t birth = 0;
  std::uint64_t arrival = 0;   // revision of the map with which it came
  std::uint64_t revision = 0;  // of the map when it changed last
};

// A landmark that was fused into another one.
struct FormerLandmark {
  LandmarkId now;           // what it is part of; may itself be a former one
  std::uint64_t since = 0;  // Map::keyframes_ever when it happened
};

// A keyframe that was culled.
struct FormerKeyframe {
  KeyframeId anchor;        // what it hangs on; may itself be a former one
  Sim3 anchor_from_camera;  // between both keyframes' own units; fixed from then on
  std::uint64_t since = 0;  // Map::keyframes_ever when it happened
};

// A loop that was closed (loop.h): an edge for later pose graphs, and what clients have to know.
struct LoopEdge {
  KeyframeId query, candidate;
  // Camera to camera, as verified, between both keyframes' own units: what was measured does not
  // change when the map's scale does.
  Sim3 candidate_from_query;
  int inliers = 0;  // landmarks that both show

  // Of a merge: how the part that moved lay before, and which runs (epochs of clients) went on in
  // it: had their latest keyframe there.
  bool merges = false;
  Sim3 new_map_from_old_map;
  std::vector<std::uint64_t> moved;  // ascending
  // Runs that had keyframes both in it and elsewhere; their clients can't move all that they have
  // as one. Ascending. Not saved: who is told after a restart is told everything.
  std::vector<std::uint64_t> split;
};

// Landmarks with neighbouring numbers were made together, from one keyframe, and change together.
template <>
struct CowShardHash<LandmarkId> {
  std::size_t operator()(const LandmarkId& id) const {
    return std::hash<LandmarkId>{}({id.origin, id.number >> 8});
  }
};

struct Map {
  MapId id;
  std::uint64_t revision = 0;        // grows by one with every event applied
  std::uint32_t merge_epoch = 0;     // grows by one with every loop closed or part merged
  std::uint64_t keyframes_ever = 0;  // inserted so far, culled ones included
  std::uint64_t next_landmark = 1;   // next number of a landmark made by the server

  CowTable<KeyframeId, KeyframeNode> keyframes;
  CowTable<LandmarkId, Landmark> landmarks;
  // Landmarks fused into another one: clients may go on reporting the old name for a while.
  CowTable<LandmarkId, FormerLandmark> replaced_landmarks;
  // Culled keyframes, for the poses that clients have hung on them.
  CowTable<KeyframeId, FormerKeyframe> removed_keyframes;
  // Both forget what is old (forget_former() in apply.h). An entry that leads to another one is
  // older than that one, so that forgetting the oldest first cuts no way short.

  // Loops closed and parts merged, in order. Where a keyframe is culled the edge goes on from its
  // anchor; both ends may so come to be one.
  std::vector<LoopEdge> loops;

  // By run (epoch) of a client: its keyframes 0 .. n-1 have been through local mapping.
  CowTable<std::uint64_t, std::uint32_t> mapped_keyframes;

  // Follows replacements to the name in use; not valid when that landmark is gone.
  LandmarkId resolve(LandmarkId id) const;
  // What holds the place of a keyframe that is or was in the map: itself, or, once it is removed,
  // what it was removed in favour of. Others come back as they are.
  KeyframeId present(KeyframeId id) const;
  // Pose of a keyframe that is or once was in the map; nothing for others. The second with the
  // keyframe's own unit (KeyframeNode::scaled_pose()).
  std::optional<Rigid3> pose_of(KeyframeId id) const;
  std::optional<Sim3> scaled_pose_of(KeyframeId id) const;
  // The entry of mapped_keyframes; 0 when there is none.
  std::uint32_t mapped_of(std::uint64_t epoch) const;
  // Keyframes that are in the map and have not been through local mapping, in order of arrival.
  std::vector<KeyframeId> unmapped() const;
};

using Snapshot = std::shared_ptr<const Map>;

}  // namespace cairn
