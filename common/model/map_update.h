// What the server tells one client about the map: the difference between what the client knows and
// what the map says now, around the client.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/geometry/sim3.h"
#include "common/model/features.h"
#include "common/model/ids.h"

namespace cairn {

// A feature of one of the client's own keyframes, by the keyframe's sequence.
struct OwnFeature {
  std::uint32_t sequence = 0;
  std::uint16_t feature = 0;

  auto operator<=>(const OwnFeature&) const = default;
};

// A landmark that is new to the client, or looks other than it did.
struct LandmarkState {
  LandmarkId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map
  // Mean viewing direction, landmark to camera, unit length, in map.
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  // Distances (metres) between which its features can be found: outside, it shows at an octave that
  // the pyramid does not have.
  float min_distance = 0, max_distance = 0;
  // What it looks like: the descriptor or, where the client has that itself, whose it is.
  Descriptor descriptor{};
  std::optional<OwnFeature> shown_by{};
  // Keyframes that see it, the latest last; not all of them (kMaxObservers), but in any case the
  // one that the server moves it with.
  std::vector<KeyframeId> observers;

  static constexpr std::size_t kMaxObservers = 6;
  // `shown_by` names none but the latest so many keyframes that have been through local mapping.
  // The client keeps the features of half as many again.
  static constexpr std::uint32_t kShownByLatest = 40;
};

// A landmark that the client knows and that lies elsewhere now.
struct LandmarkMove {
  LandmarkId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map
};

// A landmark that the client should forget, or know by another name from now on.
struct LandmarkRemoval {
  LandmarkId id;
  std::optional<LandmarkId> replaced_by;
};

// Pose of one of the client's own keyframes, and how large its own unit is in the map's (Keyframe).
struct KeyframePose {
  KeyframeId id;
  Sim3 map_from_camera;
};

// A keyframe that the map no longer holds; its pose and unit follow from another one's.
struct KeyframeRemoval {
  KeyframeId id;
  KeyframeId anchor;
  Sim3 anchor_from_camera;
};

// The client's own keyframes from sequence `first` on, up to the next entry's, lie in one part of
// the map: the same as others with this number.
struct PartOfRun {
  std::uint32_t first = 0, part = 0;

  auto operator<=>(const PartOfRun&) const = default;
};

struct MapUpdate {
  MapId map;
  // The update takes the client from `base_revision` to `revision` (both of this client's stream of
  // updates). base_revision 0: a full refresh, which replaces all that the client knows.
  std::uint64_t base_revision = 0;
  std::uint64_t revision = 0;
  // Counts loop closures and merges: a change of more than a little. With a merge,
  // `new_map_from_old_map` tells how the client's former map lies in this one.
  std::uint32_t merge_epoch = 0;
  std::optional<Sim3> new_map_from_old_map;
  // Keyframes 0 .. mapped_keyframes-1 of the client's epoch have been through local mapping.
  std::uint64_t epoch = 0;
  std::uint32_t mapped_keyframes = 0;
  // A loop was closed: landmarks that this update doesn't tell of move with the keyframe that made
  // them, until they are told.
  bool landmarks_follow = false;
  // To a client that has said that it is finishing: no more corrections are under way.
  bool settled = false;
  // Where the client is, in map, more or less: on the wire positions of landmarks are rounded to a
  // share of their distance from here.
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();

  // All ascending by id, `parts` by sequence.
  std::vector<KeyframePose> keyframes;
  std::vector<KeyframeRemoval> removed_keyframes;
  // Which of keyframes 0 .. mapped_keyframes-1 hang together, when that is news: a client that was
  // lost may have been in several parts of the map. Takes the place of what was told before.
  std::vector<PartOfRun> parts;
  std::vector<LandmarkState> landmarks;
  std::vector<LandmarkMove> moved_landmarks;
  std::vector<LandmarkRemoval> removed_landmarks;

  bool is_refresh() const { return base_revision == 0; }
};

}  // namespace cairn
