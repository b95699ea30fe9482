// What the server tells each client: the difference between the map and what the client has been
// told so far.
//
//   ClientView view(client.epoch);
//   if (auto update = view.difference(*snapshot, mapped)) ingest.publish(client, *update);
//
// A client hears about
// - its own keyframes: every one that has moved or was culled, wherever it is, at once;
// - landmarks around it: those of the keyframes most covisible with its latest one that are new to
//   it or have moved, the nearest relations first, a limited number an update; the rest comes with
//   the next updates. What has moved by less than the client could notice is not sent again;
// - landmarks that it knows and that are gone or go by another name: at once around it, elsewhere
//   within some updates.
// The view also bounds what the client has to keep: landmarks that it has not been near for longest
// are taken back when there are too many, and sent again when it returns.
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "common/model/map_update.h"
#include "server/map/map.h"

namespace cairn {

struct PublishOptions {
  // A keyframe is sent again when it has moved by more than these, metres and radians.
  double pose_moved = 1e-4, pose_turned = 1e-4;
  // A landmark, by more than this (metres) and more than this share of its distance from the
  // camera: 3e-4 shows as a sixth of a pixel at fx = 520.
  double landmark_moved = 5e-4, landmark_moved_share = 3e-4;
  std::size_t keyframes_around = 30;
  std::size_t max_landmarks = 1000;  // new or moved, an update; about 90 bytes each on the wire
  std::size_t max_known = 20'000;    // landmarks that the client is left with
};

// One for each run of a client; copies nothing of the map but what it needs to compare. For one
// thread at a time. A difference costs about a millisecond, most of it for landmarks around.
class ClientView {
 public:
  enum class Kind {
    kChanges,
    kRefresh,  // the client starts over with what this update says: after a gap
  };

  explicit ClientView(std::uint64_t epoch, const PublishOptions& options = {})
      : epoch_(epoch), options_(options) {}

  // What to tell the client; from then on it is taken as told. Nothing when there is nothing to
  // tell. The first update and the first one from another map are refreshes. Keyframes 0 ..
  // mapped_keyframes-1 of the client have been through local mapping.
  // `settled`: the client is finishing and no more corrections are under way.
  std::optional<MapUpdate> difference(const Map& map, std::uint32_t mapped_keyframes,
                                      Kind kind = Kind::kChanges, bool settled = false);

  std::size_t known_landmarks() const { return slot_of_.size(); }

 private:
  enum class Told : std::uint8_t { kNothing, kPose, kRemoval };
  struct OwnKeyframe {
    Told told = Told::kNothing;
    bool counted = false;    // the landmarks made from it are among the known ones
    Rigid3 map_from_camera;  // as told
  };
  // A landmark that the client has. One that the client has made itself is known to it before the
  // server tells it where it is.
  struct Known {
    LandmarkId id;  // not valid: a free slot
    bool told = false;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  // as told
    std::uint32_t observations = 0;                      // how many there were when told
    std::uint64_t revision = 0;                          // of the landmark when last compared
    std::uint64_t last_near = 0;                         // the difference in which it was near
  };
  using Slot = std::uint32_t;

  void start_over();
  void follow_loops(const Map& map, MapUpdate& update);
  void compare_keyframes(const Map& map, std::uint32_t count, MapUpdate& update);
  void compare_pose(const KeyframeNode& node, OwnKeyframe& own, MapUpdate& update) const;
  void tell_removal(const Map& map, std::uint32_t sequence, MapUpdate& update);
  void count_own_landmarks(const KeyframeNode& node);
  std::optional<KeyframeId> nearest_own(const Map& map, std::uint32_t sequence) const;

  void check_vanished(const Map& map, MapUpdate& update);
  void check_vanished(const Map& map, Slot slot, MapUpdate& update);
  void compare_landmarks_around(const Map& map, MapUpdate& update);
  void compare_landmark(const Landmark& landmark, Slot slot, const Eigen::Vector3d& camera,
                        MapUpdate& update);
  void tell(const Landmark& landmark, Known& known, MapUpdate& update) const;
  void take_back_the_farthest(MapUpdate& update);

  Slot know(LandmarkId id);
  void forget(Slot slot);

  std::uint64_t epoch_;
  PublishOptions options_;
  std::uint64_t revision_ = 0;  // of the stream of updates
  std::optional<MapId> map_;    // that the client has been told about
  std::uint32_t merge_epoch_ = 0, mapped_keyframes_ = 0;
  bool settled_ = false;  // as told
  std::uint64_t differences_ = 0;

  std::vector<OwnKeyframe> keyframes_;  // by sequence
  std::vector<Known> known_;
  std::vector<Slot> free_;
  std::unordered_map<LandmarkId, Slot> slot_of_;
  std::vector<Slot> near_;  // landmarks that were around in the last difference, or made since
  Slot next_check_ = 0;     // where the round through all known landmarks goes on
};

}  // namespace cairn
