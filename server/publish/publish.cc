#include "server/publish/publish.h"

#include <algorithm>
#include <unordered_set>

#include "server/publish/landmark_state.h"
#include "server/publish/neighbourhood.h"

namespace cairn {
namespace {

// Known landmarks that are checked for being gone in each difference, besides those around.
constexpr std::size_t kChecksEach = 1000;
// After a refresh the client may still hold landmarks that it made from so many latest keyframes.
constexpr std::uint32_t kProvisionalKeyframes = 60;
// Keyframes that are asked for a way to one that was culled.
constexpr int kNearestAsked = 20;

// The name that a client's landmark goes by now; nothing when it is gone.
std::optional<LandmarkId> name_now(const Map& map, LandmarkId id) {
  const LandmarkId resolved = map.resolve(id);
  if (map.landmarks.contains(resolved)) return resolved;
  if (id.origin == LandmarkId::kServer) return std::nullopt;
  // It was named after a feature: what that feature shows is what the client means.
  const KeyframeNode* node = map.keyframes.find(id.creator());
  if (!node || id.creator_feature() >= node->landmarks.size()) return std::nullopt;
  const LandmarkId shown = node->landmarks[id.creator_feature()];
  if (!shown.is_valid()) return std::nullopt;
  return shown;
}

// The keyframe in the map that holds the place of one that was culled.
KeyframeId present(const Map& map, KeyframeId id) {
  while (const FormerKeyframe* former = map.removed_keyframes.find(id)) id = former->anchor;
  return id;
}

// Not valid for a keyframe that the map does not have.
KeyframeId root_of(const Map& map, KeyframeId id) {
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return {};
  for (; node->parent.is_valid(); node = &map.keyframes.at(id)) id = node->parent;
  return id;
}

}  // namespace

std::optional<MapUpdate> ClientView::difference(const Map& map, std::uint32_t mapped_keyframes,
                                                Kind kind, bool settled) {
  const bool refresh = kind == Kind::kRefresh || map_ != map.id;
  if (refresh) start_over();
  const bool news = refresh || mapped_keyframes != mapped_keyframes_ ||
                    map.merge_epoch != merge_epoch_ || settled != settled_;
  ++differences_;
  MapUpdate update;
  if (!refresh) follow_loops(map, update);
  update.map = map.id;
  update.merge_epoch = merge_epoch_ = map.merge_epoch;
  update.epoch = epoch_;
  update.mapped_keyframes = mapped_keyframes_ = mapped_keyframes;
  update.settled = settled_ = settled;
  map_ = map.id;

  compare_keyframes(map, mapped_keyframes, update);
  check_vanished(map, update);
  compare_landmarks_around(map, update);
  take_back_the_farthest(update);

  if (!news && update.keyframes.empty() && update.removed_keyframes.empty() &&
      update.landmarks.empty() && update.removed_landmarks.empty())
    return std::nullopt;
  update.base_revision = refresh ? 0 : revision_;
  update.revision = ++revision_;
  return update;
}

// A part that was merged into another one has moved as a whole: the client moves what it has. After
// a loop the client lets its landmarks follow its keyframes, and is told anew where they are once
// it comes near them; likewise where it has been in both parts, so that not all that it has moves.
void ClientView::follow_loops(const Map& map, MapUpdate& update) {
  Sim3 move;
  for (std::size_t i = merge_epoch_; i < map.loops.size(); ++i) {
    const LoopEdge& loop = map.loops[i];
    const bool split = std::binary_search(loop.split.begin(), loop.split.end(), epoch_);
    if (!loop.merges || split) {
      update.landmarks_follow = true;
      for (Known& known : known_) known.told = false;
    }
    // What they were told to hang on may lie in the other part.
    for (OwnKeyframe& own : keyframes_)
      if (split && own.told == Told::kRemoval) own.told = Told::kNothing;
    if (loop.merges && std::binary_search(loop.moved.begin(), loop.moved.end(), epoch_)) {
      move = loop.new_map_from_old_map * move;
      update.new_map_from_old_map = move;
    }
  }
  if (!update.new_map_from_old_map) return;
  for (OwnKeyframe& own : keyframes_) own.map_from_camera = move.move_pose(own.map_from_camera);
  for (Known& known : known_) known.position = move * known.position;
}

void ClientView::start_over() {
  for (OwnKeyframe& own : keyframes_) own.told = Told::kNothing;
  const std::size_t latest = std::min<std::size_t>(kProvisionalKeyframes, keyframes_.size());
  for (std::size_t i = keyframes_.size() - latest; i < keyframes_.size(); ++i)
    keyframes_[i].counted = false;
  known_.clear();
  free_.clear();
  slot_of_.clear();
  near_.clear();
  next_check_ = 0;
}

void ClientView::compare_keyframes(const Map& map, std::uint32_t count, MapUpdate& update) {
  // Sequences may have gaps where another server's journal was lost; past the mapped ones there are
  // those that have just arrived.
  std::size_t size = std::max<std::size_t>(count, keyframes_.size());
  const auto exists = [&](std::size_t sequence) {
    const KeyframeId id{epoch_, static_cast<std::uint32_t>(sequence)};
    return map.keyframes.contains(id) || map.removed_keyframes.contains(id);
  };
  while (exists(size)) ++size;
  if (keyframes_.empty() && size > kProvisionalKeyframes)
    // A view that is new to a long run, after the server's restart.
    keyframes_.resize(size - kProvisionalKeyframes,
                      {.told = Told::kNothing, .counted = true, .map_from_camera = {}});
  keyframes_.resize(size);

  for (std::uint32_t sequence = 0; sequence < size; ++sequence) {
    OwnKeyframe& own = keyframes_[sequence];
    const KeyframeNode* node = map.keyframes.find({epoch_, sequence});
    if (node) {
      compare_pose(*node, own, update);
      if (!own.counted) count_own_landmarks(*node);
      own.counted = true;
    } else if (own.told != Told::kRemoval) {
      tell_removal(map, sequence, update);
    }
  }
}

void ClientView::compare_pose(const KeyframeNode& node, OwnKeyframe& own, MapUpdate& update) const {
  const Rigid3& pose = node.map_from_camera;
  if (own.told == Told::kPose) {
    const Rigid3& old = own.map_from_camera;
    const bool same =
        old.translation == pose.translation && old.rotation.coeffs() == pose.rotation.coeffs();
    if (same) return;
    const bool close = (old.translation - pose.translation).norm() <= options_.pose_moved &&
                       old.rotation.angularDistance(pose.rotation) <= options_.pose_turned;
    if (close) return;
  }
  own.told = Told::kPose;
  own.map_from_camera = pose;
  update.keyframes.push_back({node.keyframe->id, pose});
}

// The map may hang a culled keyframe on one of another client: tell it relative to one that this
// client has.
void ClientView::tell_removal(const Map& map, std::uint32_t sequence, MapUpdate& update) {
  const KeyframeId id{epoch_, sequence};
  const std::optional<Rigid3> pose = map.pose_of(id);
  if (!pose) return;
  const std::optional<KeyframeId> anchor = nearest_own(map, sequence);
  if (!anchor) return;
  const Rigid3& map_from_anchor = map.keyframes.at(*anchor).map_from_camera;
  update.removed_keyframes.push_back({id, *anchor, map_from_anchor.inverse() * *pose});
  keyframes_[sequence].told = Told::kRemoval;
}

// In time; if one of the nearest is known to lie in the same part of the map, that.
std::optional<KeyframeId> ClientView::nearest_own(const Map& map, std::uint32_t sequence) const {
  const KeyframeId root = root_of(map, present(map, {epoch_, sequence}));
  const auto size = static_cast<std::uint32_t>(keyframes_.size());
  std::optional<KeyframeId> nearest;
  int asked = 0;
  // True: that one, or enough asked.
  const auto consider = [&](KeyframeId id) {
    if (!map.keyframes.contains(id)) return false;
    const bool connected = root_of(map, id) == root;
    if (!nearest || connected) nearest = id;
    return connected || ++asked == kNearestAsked;
  };
  for (std::uint32_t distance = 1; distance < size; ++distance) {
    if (distance <= sequence && consider({epoch_, sequence - distance})) break;
    if (sequence + distance < size && consider({epoch_, sequence + distance})) break;
  }
  return nearest;
}

// The client has had them since it made the keyframe. Those that the map refused, or that are gone
// already, are reported by the check that follows.
void ClientView::count_own_landmarks(const KeyframeNode& node) {
  // A monocular client names a landmark after the earlier of the two keyframes that made it.
  const bool mono = node.rig().sensor == Sensor::kMono;
  for (const LandmarkMatch& match : node.keyframe->matches)
    if (match.landmark == LandmarkId::from_feature(node.keyframe->id, match.feature) ||
        (mono && match.landmark.origin == epoch_))
      near_.push_back(know(match.landmark));
}

void ClientView::check_vanished(const Map& map, MapUpdate& update) {
  // New names join near_ while it is gone through; they need no check.
  const std::vector<Slot> were_near = std::exchange(near_, {});
  for (const Slot slot : were_near) check_vanished(map, slot, update);
  for (std::size_t i = 0; i < std::min(kChecksEach, known_.size()); ++i) {
    if (next_check_ >= known_.size()) next_check_ = 0;
    check_vanished(map, next_check_++, update);
  }
}

void ClientView::check_vanished(const Map& map, Slot slot, MapUpdate& update) {
  const LandmarkId id = known_[slot].id;
  if (!id.is_valid() || map.landmarks.contains(id)) return;
  const std::optional<LandmarkId> replaced_by = name_now(map, id);
  update.removed_landmarks.push_back({id, replaced_by});
  forget(slot);
  if (!replaced_by) return;
  // A name that the client does not know would be no use to it.
  const Slot now = know(*replaced_by);
  near_.push_back(now);
  if (!known_[now].told) tell(map.landmarks.at(*replaced_by), known_[now], update);
}

void ClientView::compare_landmarks_around(const Map& map, MapUpdate& update) {
  auto latest = static_cast<std::uint32_t>(keyframes_.size());
  while (latest > 0 && !map.keyframes.contains({epoch_, latest - 1})) --latest;
  if (latest == 0) return;
  const auto around = neighbourhood(map, {epoch_, latest - 1}, options_.keyframes_around);
  for (const KeyframeNode* node : around) {
    for (const LandmarkId& id : node->landmarks) {
      if (!id.is_valid()) continue;
      const auto known = slot_of_.find(id);
      if (known == slot_of_.end() && update.landmarks.size() >= options_.max_landmarks) continue;
      const Slot slot = known == slot_of_.end() ? know(id) : known->second;
      if (known_[slot].last_near == differences_) continue;
      known_[slot].last_near = differences_;
      near_.push_back(slot);
      compare_landmark(map.landmarks.at(id), slot, around.front()->map_from_camera.translation,
                       update);
    }
  }
}

void ClientView::compare_landmark(const Landmark& landmark, Slot slot,
                                  const Eigen::Vector3d& camera, MapUpdate& update) {
  Known& known = known_[slot];
  if (known.told && known.revision == landmark.revision) return;
  if (known.told) {
    const double moved = (landmark.position - known.position).norm();
    const double distance = (landmark.position - camera).norm();
    const double limit =
        std::max(options_.landmark_moved, options_.landmark_moved_share * distance);
    // Twice the observations make a better descriptor and range of distances.
    if (moved <= limit && landmark.observations.size() < 2 * std::size_t{known.observations}) {
      known.revision = landmark.revision;
      return;
    }
  }
  if (update.landmarks.size() < options_.max_landmarks) tell(landmark, known, update);
}

void ClientView::tell(const Landmark& landmark, Known& known, MapUpdate& update) const {
  known.told = true;
  known.revision = landmark.revision;
  known.position = landmark.position;
  known.observations = static_cast<std::uint32_t>(landmark.observations.size());
  update.landmarks.push_back(state_of(landmark));
}

void ClientView::take_back_the_farthest(MapUpdate& update) {
  if (slot_of_.size() <= options_.max_known) return;
  std::vector<Slot> candidates;
  for (Slot slot = 0; slot < known_.size(); ++slot)
    if (known_[slot].id.is_valid() && known_[slot].last_near < differences_)
      candidates.push_back(slot);
  // A tenth more than needed, so that this happens rarely.
  const std::size_t wanted = slot_of_.size() - options_.max_known + options_.max_known / 10;
  const std::size_t count = std::min(wanted, candidates.size());
  std::sort(candidates.begin(), candidates.end(), [&](Slot a, Slot b) {
    return std::pair(known_[a].last_near, known_[a].id) <
           std::pair(known_[b].last_near, known_[b].id);
  });
  for (std::size_t i = 0; i < count; ++i) {
    update.removed_landmarks.push_back({known_[candidates[i]].id, std::nullopt});
    forget(candidates[i]);
  }
}

ClientView::Slot ClientView::know(LandmarkId id) {
  const auto found = slot_of_.find(id);
  if (found != slot_of_.end()) return found->second;
  Slot slot = static_cast<Slot>(known_.size());
  if (free_.empty()) {
    known_.emplace_back();
  } else {
    slot = free_.back();
    free_.pop_back();
  }
  known_[slot].id = id;
  known_[slot].last_near = differences_ - 1;
  slot_of_.emplace(id, slot);
  return slot;
}

void ClientView::forget(Slot slot) {
  slot_of_.erase(known_[slot].id);
  known_[slot] = {};
  free_.push_back(slot);
}

}  // namespace cairn
