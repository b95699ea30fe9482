// The client's own copy of the part of the map that it needs: the landmarks around it, and the
// poses of the keyframes it has made. Filled from two sides: landmarks that the client makes from
// depth or from two views are here at once ("provisional"), so that tracking never waits for the
// server; what the server sends corrects and replaces them.
//
// Everything is in the `map` frame, which is the frame of the first keyframe until the server says
// otherwise, and in its unit. Where the server changes the scale, by a loop or a merge of maps
// without depth, all that is here changes with it; what was measured relative to a keyframe stays
// as it is, in the keyframe's own unit (Keyframe, KeyframePose). A server that has lost its map, or
// another one, has another map: see change_map().
// Tracking thread only.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "common/model/keyframe.h"
#include "common/model/map_update.h"

namespace cairn {

// A landmark that feature `feature` of a new keyframe and one of an earlier keyframe, which it is
// named after, were found to show.
struct ProvisionalLandmark {
  std::uint16_t feature = 0;
  LandmarkId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map
};

struct LocalLandmark {
  LandmarkId id;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in map
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();    // unit, towards the cameras that see it
  float min_distance = 0, max_distance = 0;            // metres, see LandmarkState
  Descriptor descriptor{};
  std::vector<KeyframeId> observers;
  // While provisional it moves with this keyframe; not valid once the server knows the landmark.
  KeyframeId anchor;
  std::uint64_t last_use = 0;
};

// What names of a former map's time mean now.
class NewNames {
 public:
  void add(LandmarkId before, LandmarkId now) { names_[before] = now; }
  // Not valid for landmarks that are gone.
  LandmarkId of(LandmarkId before) const {
    const auto it = names_.find(before);
    if (it != names_.end()) return it->second;
    return before.origin == LandmarkId::kServer ? LandmarkId{} : before;
  }

 private:
  std::unordered_map<LandmarkId, LandmarkId> names_;
};

class LocalMap {
 public:
  struct Limits {
    std::size_t landmarks = 40'000;  // beyond, those not used for longest are dropped
    // Latest keyframes whose features are kept: for finding oneself again, and because the server
    // says of landmarks which feature shows them (LandmarkState::shown_by).
    std::size_t keyframes_with_features = LandmarkState::kShownByLatest * 3 / 2;
    // While the server lags behind, for the latter reason, so many more.
    std::size_t unmapped_with_features = 300;
    std::size_t former_names = 20'000;  // beyond, the oldest are forgotten
  };

  LocalMap() : LocalMap(Limits{}) {}
  explicit LocalMap(Limits limits) : limits_(limits) {}

  // Null when unknown. Follows the server's renamings. Valid until the map changes.
  const LocalLandmark* find(LandmarkId id) const;

  // Landmarks that keyframes see which share sight of any of `seen`: what may come into view now.
  // Keyframes with most shared landmarks come first; at most `max_keyframes` are asked. In a fixed
  // order; valid until the map changes.
  std::vector<const LocalLandmark*> around(std::span<const LandmarkId> seen,
                                           std::size_t max_keyframes);
  // The own keyframe that shares most of `seen`; nothing when none shares any.
  std::optional<KeyframeId> most_shared(std::span<const LandmarkId> seen) const;
  // How many of the landmarks that a keyframe saw still stand.
  int landmarks_of(KeyframeId keyframe) const;

  // Takes in a new keyframe at `map_from_camera`: its matches become observations, and those that
  // name the keyframe itself become provisional landmarks from depth.
  void add_keyframe(KeyframePtr keyframe, const Rigid3& map_from_camera);

  // Takes in a landmark that the keyframe, the one added last, has made with an earlier one.
  void add_landmark(const Keyframe& keyframe, const ProvisionalLandmark& made);

  // Takes in what the server knows. Keyframes that it has not placed yet follow the one they were
  // tracked against, provisional landmarks the keyframe that made them.
  void apply(const MapUpdate& update);

  // The map that the server's updates have told of; not set (0) before the first.
  MapId id() const { return id_; }
  // Whether an update tells of a map that has nothing to do with the one held. Say so by
  // change_map() before apply().
  bool is_of_another_map(const MapUpdate& update) const {
    return id_ != MapId{} && update.map != id_ && !update.new_map_from_old_map;
  }
  // Everything moves into the new map's frame. Keyframes that the new map does not hold keep their
  // place there, and so do the landmarks that they see: the server that has the new map knows none
  // of them, they are the client's own again. Those of the server's making get names of the
  // client's, since theirs mean others in the new map; what no own keyframe sees is dropped.
  NewNames change_map(const Sim3& new_map_from_old_map);

  // Pose of an own keyframe; nothing for others. The second with the size of its own unit.
  std::optional<Rigid3> pose_of(KeyframeId keyframe) const;
  std::optional<Sim3> scaled_pose_of(KeyframeId keyframe) const;
  // Which part of the map each own keyframe lies in, by sequence: the same number is the same part,
  // 0 that of the first one. By what the server has told, and for later keyframes by what they were
  // tracked against.
  std::vector<std::uint32_t> parts() const;
  // Latest keyframes, newest first, whose features are still held.
  std::vector<KeyframePtr> recent_keyframes() const;
  // Those of them that share sight of any of `seen`, most shared first, at most `count`.
  std::vector<KeyframePtr> keyframes_sharing(std::span<const LandmarkId> seen,
                                             std::size_t count) const;
  // The landmark that each feature of a held keyframe shows; not valid where none.
  std::vector<LandmarkId> landmarks_by_feature(const Keyframe& keyframe) const;

  std::size_t landmark_count() const { return by_id_.size(); }
  std::size_t keyframe_count() const { return keyframes_.size(); }

 private:
  using Slot = std::uint32_t;

  struct OwnKeyframe {
    KeyframeId id;
    Sim3 map_from_camera;
    KeyframeId reference;  // pose follows from this one until the server has placed the keyframe
    Sim3 reference_from_camera;
    KeyframeId tracked_against;
    bool placed_by_server = false;
    bool of_former_map = false;  // and so far unknown to the present one
    KeyframePtr keyframe;        // null once its features were let go
  };

  OwnKeyframe* own(KeyframeId id);
  const OwnKeyframe* own(KeyframeId id) const;
  std::optional<Slot> slot_of(LandmarkId id) const;
  Slot insert(LocalLandmark landmark);
  void observe(Slot slot, KeyframeId keyframe);
  void forget_needless_views(KeyframeId culled);
  void remove(LandmarkId id);
  void rename(LandmarkId from, LandmarkId to);
  std::vector<std::pair<KeyframeId, int>> votes(std::span<const LandmarkId> seen) const;
  LandmarkId current_name(LandmarkId id) const;
  void move(const Sim3& new_map_from_old_map);
  NewNames take_over_landmarks();
  void take_over_keyframe(OwnKeyframe& mine, const NewNames& names) const;
  const OwnKeyframe* first_own_observer(const LocalLandmark& landmark) const;
  bool is_known_to_server(const LocalLandmark& landmark, const MapUpdate& update) const;
  void forget_servers_landmarks(const MapUpdate& update);
  void place_keyframes(const MapUpdate& update);
  void update_landmark(const LandmarkState& state);
  const Descriptor* descriptor_of(const LandmarkState& state) const;
  void let_features_go();
  void enforce_limits();

  Limits limits_;
  MapId id_;
  std::vector<LocalLandmark> slots_;
  std::vector<Slot> free_slots_;
  std::unordered_map<LandmarkId, Slot> by_id_;
  std::unordered_map<LandmarkId, LandmarkId> renamed_;
  std::deque<LandmarkId> renamed_in_order_;                    // the keys, with some that are gone
  std::unordered_map<KeyframeId, std::vector<Slot>> seen_by_;  // also of other clients' keyframes
  std::vector<OwnKeyframe> keyframes_;                         // by sequence; all of one epoch
  std::size_t first_with_features_ = 0;                        // into keyframes_
  std::size_t mapped_keyframes_ = 0;                           // as the server has told
  std::vector<PartOfRun> told_parts_;                          // of so many first keyframes:
  std::size_t told_of_ = 0;
  std::vector<std::uint64_t> mark_;  // a slot: the last query that took it
  std::uint64_t queries_ = 0;
};

}  // namespace cairn
