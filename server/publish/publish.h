// What the server tells each client: the difference between the map and what the client has been
// told so far.
//
//   ClientView view(client.epoch);
//   if (auto update = view.difference(*snapshot, mapped)) ingest.publish(client, *update);
//
// A client hears about
// - its own keyframes: every one that has moved or was culled, wherever it is, at once; and
//   which of them hang together, once it has been in several parts of the map;
// - landmarks that it knows and that are gone or go by another name: at once around it, elsewhere
//   within some updates;
// - landmarks around it: those of the keyframes most covisible with its latest one that are new to
//   it, lie elsewhere than it believes, or are known better than when they were described to it.
//   What is worth most a byte comes first: what is in its view or about to be, before what is
//   beside, and what is off by many pixels before what is off by few. What has moved by less than
//   the client could notice is not sent.
// The last are bounded by a budget of bytes a second (byte_budget.h); what doesn't fit comes with
// the next updates, if it is still wanted then.
//
// The view also bounds what the client has to keep: landmarks that it has not been near for longest
// are taken back when there are too many, and sent again when it returns.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/model/map_update.h"
#include "server/map/map.h"
#include "server/publish/byte_budget.h"
#include "server/publish/known_landmarks.h"
#include "server/publish/outlook.h"

namespace cairn {

struct PublishOptions {
  // A keyframe is sent again when it has moved by more than these, metres and radians, or its unit
  // has changed by more than this share.
  double pose_moved = 1e-4, pose_turned = 1e-4, unit_changed = 1e-4;
  // A landmark, when the client could notice by more than so many pixels (Outlook::shift_px).
  double landmark_moved_px = 0.05;
  std::size_t keyframes_around = 30;
  std::size_t max_known = 20'000;  // landmarks that the client is left with
  // Bytes of updates a second of the client's time, in the long run, and how many it can save.
  double bytes_per_s = 45'000, most_saved_bytes = 100'000;
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
      : epoch_(epoch), options_(options), budget_(options.bytes_per_s, options.most_saved_bytes) {}

  // What to tell the client; from then on it is taken as told. Nothing when there is nothing to
  // tell. The first update and the first one from another map are refreshes. Keyframes 0 ..
  // mapped_keyframes-1 of the client have been through local mapping.
  // `settled`: the client is finishing and no more corrections are under way.
  std::optional<MapUpdate> difference(const Map& map, std::uint32_t mapped_keyframes,
                                      Kind kind = Kind::kChanges, bool settled = false);

  std::size_t known_landmarks() const { return known_.size(); }

 private:
  enum class Told : std::uint8_t { kNothing, kPose, kRemoval };
  struct OwnKeyframe {
    Told told = Told::kNothing;
    bool counted = false;  // the landmarks made from it are among the known ones
    Sim3 map_from_camera;  // as told
  };
  using Slot = KnownLandmarks::Slot;
  // Something that could be told of a landmark.
  struct News {
    const Landmark* landmark = nullptr;
    std::optional<Slot> slot{};            // nothing: not known yet
    bool describes = false;                // or else only says where it is
    std::optional<OwnFeature> shown_by{};  // with a description
    double worth = 0;                      // pixels, more or less
    std::size_t bytes = 0, closeness = 0;  // the fewer the better
  };

  void start_over();
  void follow_loops(const Map& map, MapUpdate& update);
  void compare_keyframes(const Map& map, std::uint32_t count, MapUpdate& update);
  void compare_pose(const KeyframeNode& node, OwnKeyframe& own, MapUpdate& update) const;
  void tell_removal(const Map& map, std::uint32_t sequence, MapUpdate& update);
  void count_own_landmarks(const Map& map, const KeyframeNode& node);
  std::optional<KeyframeId> nearest_own(const Map& map, std::uint32_t sequence) const;
  void tell_parts(const Map& map, MapUpdate& update);

  void check_vanished(const Map& map, MapUpdate& update);
  void check_vanished(const Map& map, Slot slot, MapUpdate& update);
  void move_anchored(const Map& map);
  void tell_of_landmarks_around(const Map& map, MapUpdate& update);
  std::vector<News> news_around(const Map& map, const std::vector<const KeyframeNode*>& around,
                                const Outlook& outlook);
  std::optional<News> news_of(const Map& map, const Landmark& landmark, const Outlook& outlook,
                              std::optional<Slot> slot);
  std::optional<OwnFeature> own_feature_of(const Map& map, const Landmark& landmark) const;
  void tell(const News& news, MapUpdate& update);
  void take_back_the_farthest(MapUpdate& update);

  std::uint64_t epoch_;
  PublishOptions options_;
  std::uint64_t revision_ = 0;  // of the stream of updates
  std::optional<MapId> map_;    // that the client has been told about
  std::uint32_t merge_epoch_ = 0, mapped_keyframes_ = 0;
  bool settled_ = false;  // as told
  // Landmarks that keyframes from this one on have made the client has of its own.
  std::uint32_t provisional_from_ = 0;
  std::uint64_t differences_ = 0;

  std::vector<OwnKeyframe> keyframes_;  // by sequence
  std::vector<PartOfRun> parts_;        // as told
  bool parts_may_differ_ = false;
  KnownLandmarks known_;
  ByteBudget budget_;
  std::vector<Slot> near_;      // landmarks that were around in the last difference, or made since
  std::vector<Slot> anchored_;  // landmarks that move with the keyframe that made them
  Slot next_check_ = 0;         // where the round through all known landmarks goes on
};

}  // namespace cairn
