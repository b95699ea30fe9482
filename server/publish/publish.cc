#include "server/publish/publish.h"

#include <algorithm>
#include <cmath>

#include "common/wire/map_update_codec.h"
#include "server/map/connected.h"
#include "server/map/landmark_set.h"
#include "server/publish/landmark_state.h"
#include "server/publish/neighbourhood.h"
#include "server/publish/parts_of_run.h"

namespace cairn {
namespace {

// Known landmarks that are checked for being gone in each difference, besides those around.
constexpr std::size_t kChecksEach = 1000;
// After a refresh the client may still hold landmarks that it made from so many latest keyframes.
constexpr std::uint32_t kProvisionalKeyframes = 60;

// Keyframes that are asked for a way to one that was culled.
constexpr int kNearestAsked = 20;

// What news is worth, in pixels that it puts right or as good as puts right. A landmark that the
// client does not have can't be matched at all; one whose place is not known may be anywhere.
constexpr double kWorthOfNew = 10, kWorthOfPlace = 5, kMostWorthOfMove = 10;
// Of knowing better what it looks like and who sees it, once there are twice the observations.
constexpr double kWorthOfLook = 0.5;
// What lies beside the client's view counts so much.
constexpr double kBeside = 0.3;

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

template <typename List>
void sort_by_id(List& list) {
  std::sort(list.begin(), list.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
}

// Whether the client would look for the landmark at wrong distances.
bool has_other_range(const KnownLandmark& known, const Landmark& landmark) {
  constexpr float kTolerance = 0.1f;
  return known.max_distance > 0 &&
         std::abs(landmark.max_distance / known.max_distance - 1) > kTolerance;
}

void sort_by_id(MapUpdate& update) {
  sort_by_id(update.keyframes);
  sort_by_id(update.removed_keyframes);
  sort_by_id(update.landmarks);
  sort_by_id(update.moved_landmarks);
  sort_by_id(update.removed_landmarks);
}

}  // namespace

std::optional<MapUpdate> ClientView::difference(const Map& map, std::uint32_t mapped_keyframes,
                                                Kind kind, bool settled) {
  const bool refresh = kind == Kind::kRefresh || map_ != map.id;
  if (refresh) start_over();
  // Only a merge joins parts, and only a keyframe that was tracked against nobody of the run's own
  // begins one.
  parts_may_differ_ |= refresh || map.merge_epoch != merge_epoch_;
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
  if (refresh) provisional_from_ = mapped_keyframes;

  compare_keyframes(map, mapped_keyframes, update);
  if (parts_may_differ_ || settled) tell_parts(map, update);
  move_anchored(map);
  check_vanished(map, update);
  tell_of_landmarks_around(map, update);
  take_back_the_farthest(update);

  if (!news && update.keyframes.empty() && update.removed_keyframes.empty() &&
      update.parts.empty() && update.landmarks.empty() && update.moved_landmarks.empty() &&
      update.removed_landmarks.empty())
    return std::nullopt;
  sort_by_id(update);
  update.base_revision = refresh ? 0 : revision_;
  update.revision = ++revision_;
  budget_.spend(wire::encoded_bytes({}, update));
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
      for (KnownLandmark& known : known_.slots()) known.position.reset();
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
  for (OwnKeyframe& own : keyframes_) own.map_from_camera = move * own.map_from_camera;
  for (KnownLandmark& known : known_.slots()) {
    if (known.position) known.position = move * *known.position;
    known.max_distance *= static_cast<float>(move.scale);
  }
}

void ClientView::start_over() {
  parts_.clear();
  for (OwnKeyframe& own : keyframes_) own.told = Told::kNothing;
  const std::size_t latest = std::min<std::size_t>(kProvisionalKeyframes, keyframes_.size());
  for (std::size_t i = keyframes_.size() - latest; i < keyframes_.size(); ++i)
    keyframes_[i].counted = false;
  known_.clear();
  near_.clear();
  anchored_.clear();
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
      if (sequence > 0 && own.told == Told::kNothing && node->keyframe->reference.epoch != epoch_)
        parts_may_differ_ = true;
      compare_pose(*node, own, update);
      if (!own.counted) count_own_landmarks(map, *node);
      own.counted = true;
    } else if (own.told != Told::kRemoval) {
      tell_removal(map, sequence, update);
    }
  }
}

void ClientView::compare_pose(const KeyframeNode& node, OwnKeyframe& own, MapUpdate& update) const {
  const Sim3 pose = node.scaled_pose();
  if (own.told == Told::kPose) {
    const Sim3& old = own.map_from_camera;
    const bool same = old.translation == pose.translation && old.scale == pose.scale &&
                      old.rotation.coeffs() == pose.rotation.coeffs();
    if (same) return;
    const bool close = (old.translation - pose.translation).norm() <= options_.pose_moved &&
                       old.rotation.angularDistance(pose.rotation) <= options_.pose_turned &&
                       std::abs(old.scale / pose.scale - 1) <= options_.unit_changed;
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
  const std::optional<Sim3> pose = map.scaled_pose_of(id);
  if (!pose) return;
  const std::optional<KeyframeId> anchor = nearest_own(map, sequence);
  if (!anchor) return;
  const Sim3 map_from_anchor = map.keyframes.at(*anchor).scaled_pose();
  update.removed_keyframes.push_back({id, *anchor, map_from_anchor.inverse() * *pose});
  keyframes_[sequence].told = Told::kRemoval;
}

void ClientView::tell_parts(const Map& map, MapUpdate& update) {
  std::vector<PartOfRun> parts = parts_of_run(map, epoch_, mapped_keyframes_);
  parts_may_differ_ = keyframes_.size() > mapped_keyframes_;  // of which nothing is said yet
  if (parts == parts_) return;
  parts_ = update.parts = std::move(parts);
}

// In time; if one of the nearest is known to lie in the same part of the map, that.
std::optional<KeyframeId> ClientView::nearest_own(const Map& map, std::uint32_t sequence) const {
  const KeyframeId root = root_of(map, map.present({epoch_, sequence}));
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

// The client has had them since it made the keyframe, and knows what they look like; unless it has
// started over since. Those that the map refused, or that are gone already, are reported by the
// check that follows.
void ClientView::count_own_landmarks(const Map& map, const KeyframeNode& node) {
  // A monocular client names a landmark after the earlier of the two keyframes that made it. Where
  // only a lost map had that one, the landmark is none of this map's business.
  const bool mono = node.rig().sensor == Sensor::kMono;
  const auto is_of_pair = [&](LandmarkId id) {
    return mono && id.origin == epoch_ &&
           (map.keyframes.contains(id.creator()) || map.removed_keyframes.contains(id.creator()));
  };
  const bool is_held = node.keyframe->id.sequence >= provisional_from_;
  for (const LandmarkMatch& match : node.keyframe->matches) {
    const bool makes = match.landmark == LandmarkId::from_feature(node.keyframe->id, match.feature);
    if (!makes && !is_of_pair(match.landmark)) continue;
    const bool is_new = !known_.find(match.landmark);
    const Slot slot = known_.know(match.landmark);
    near_.push_back(slot);
    if (!is_new || !is_held) continue;
    known_[slot].described = true;
    known_[slot].observations = makes ? 1 : 2;
    known_[slot].anchored = makes;
    if (makes) anchored_.push_back(slot);
  }
}

// What the client has made from depth moves with the keyframe that made it until that one has been
// through local mapping, and stays from then on.
void ClientView::move_anchored(const Map& map) {
  std::erase_if(anchored_, [&](Slot slot) {
    KnownLandmark& known = known_[slot];
    if (!known.anchored) return true;
    const KeyframeId creator = known.id.creator();
    const KeyframeNode* node = map.keyframes.find(creator);
    const std::uint16_t f = known.id.creator_feature();
    known.position.reset();
    if (node && node->features().points[f].has_depth()) {
      const Feature& feature = node->features().points[f];
      const PinholeCamera& camera = node->rig().camera;
      known.position = keyframes_[creator.sequence].map_from_camera *
                       camera.unproject(feature.pixel(), camera.depth(feature.disparity));
    }
    known.anchored = creator.sequence >= mapped_keyframes_;
    return !known.anchored;
  });
}

void ClientView::check_vanished(const Map& map, MapUpdate& update) {
  // New names join near_ while it is gone through; they need no check.
  const std::vector<Slot> were_near = std::exchange(near_, {});
  for (const Slot slot : were_near) check_vanished(map, slot, update);
  const std::size_t all = known_.slots().size();
  for (std::size_t i = 0; i < std::min(kChecksEach, all); ++i) {
    if (next_check_ >= all) next_check_ = 0;
    check_vanished(map, next_check_++, update);
  }
}

void ClientView::check_vanished(const Map& map, Slot slot, MapUpdate& update) {
  const LandmarkId id = known_[slot].id;
  if (!id.is_valid() || map.landmarks.contains(id)) return;
  const std::optional<LandmarkId> replaced_by = name_now(map, id);
  update.removed_landmarks.push_back({id, replaced_by});
  known_.forget(slot);
  if (!replaced_by) return;
  // A name that the client does not know would be no use to it.
  const Slot now = known_.know(*replaced_by);
  near_.push_back(now);
  if (known_[now].described) return;
  const Landmark& landmark = map.landmarks.at(*replaced_by);
  tell({.landmark = &landmark,
        .slot = now,
        .describes = true,
        .shown_by = own_feature_of(map, landmark)},
       update);
}

void ClientView::tell_of_landmarks_around(const Map& map, MapUpdate& update) {
  auto latest = static_cast<std::uint32_t>(keyframes_.size());
  while (latest > 0 && !map.keyframes.contains({epoch_, latest - 1})) --latest;
  if (latest == 0) return;
  const auto around = neighbourhood(map, {epoch_, latest - 1}, options_.keyframes_around);
  const KeyframeNode* before = latest > 1 ? map.keyframes.find({epoch_, latest - 2}) : nullptr;
  const Outlook outlook(*around.front(), before);
  update.centre = outlook.centre();
  budget_.advance(around.front()->keyframe->stamp_ns);

  std::vector<News> all = news_around(map, around, outlook);
  std::sort(all.begin(), all.end(), [](const News& a, const News& b) {
    const double of_a = a.worth / static_cast<double>(a.bytes);
    const double of_b = b.worth / static_cast<double>(b.bytes);
    if (of_a != of_b) return of_a > of_b;
    if (a.closeness != b.closeness) return a.closeness < b.closeness;
    return a.landmark->id < b.landmark->id;
  });
  double room = budget_.available() - static_cast<double>(wire::encoded_bytes({}, update));
  for (const News& news : all) {
    room -= static_cast<double>(news.bytes);
    if (room < 0) break;
    tell(news, update);
  }
}

std::vector<ClientView::News> ClientView::news_around(
    const Map& map, const std::vector<const KeyframeNode*>& around, const Outlook& outlook) {
  std::vector<News> all;
  LandmarkSet seen(1000);
  for (std::size_t i = 0; i < around.size(); ++i) {
    for (const LandmarkId& id : around[i]->landmarks) {
      if (!id.is_valid() || !seen.insert(id)) continue;
      const auto slot = known_.find(id);
      if (slot) {
        known_[*slot].last_near = differences_;
        near_.push_back(*slot);
      }
      auto news = news_of(map, map.landmarks.at(id), outlook, slot);
      if (!news) continue;
      news->closeness = i;
      all.push_back(*news);
    }
  }
  return all;
}

std::optional<ClientView::News> ClientView::news_of(const Map& map, const Landmark& landmark,
                                                    const Outlook& outlook,
                                                    std::optional<Slot> slot) {
  KnownLandmark* known = slot ? &known_[*slot] : nullptr;
  if (known && known->described && known->position && !known->anchored &&
      known->revision == landmark.revision)
    return std::nullopt;
  News news{.landmark = &landmark, .slot = slot};
  const bool is_described = known && known->described;
  if (!is_described) {
    news.describes = true;
    news.worth = kWorthOfNew;
  } else {
    const double shift =
        known->position ? outlook.shift_px(*known->position, landmark.position) : 0;
    if (!known->position) news.worth = kWorthOfPlace;
    if (shift > options_.landmark_moved_px) news.worth = std::min(shift, kMostWorthOfMove);
    // Twice the observations make a better descriptor and range of distances; after a loop that
    // changed the scale the range is another one.
    if (landmark.observations.size() >= 2 * std::size_t{known->observations} ||
        (!known->position && has_other_range(*known, landmark))) {
      news.describes = true;
      news.worth += kWorthOfLook;
    }
    if (news.worth == 0) {
      known->revision = landmark.revision;
      return std::nullopt;
    }
  }
  if (!outlook.shows(landmark.position)) news.worth *= kBeside;
  if (news.describes) news.shown_by = own_feature_of(map, landmark);
  news.bytes = news.describes ? wire::usual_bytes(state_of(landmark, news.shown_by))
                              : wire::usual_bytes(LandmarkMove{});
  return news;
}

// The feature of a late enough keyframe of the client's own whose descriptor the landmark has.
std::optional<OwnFeature> ClientView::own_feature_of(const Map& map,
                                                     const Landmark& landmark) const {
  for (auto o = landmark.observations.rbegin(); o != landmark.observations.rend(); ++o) {
    const KeyframeId id = o->keyframe;
    if (id.epoch != epoch_ || id.sequence + LandmarkState::kShownByLatest < mapped_keyframes_)
      continue;
    if (map.keyframes.at(id).features().descriptors[o->feature] == landmark.descriptor)
      return OwnFeature{id.sequence, o->feature};
  }
  return std::nullopt;
}

void ClientView::tell(const News& news, MapUpdate& update) {
  const Landmark& landmark = *news.landmark;
  const Slot slot = news.slot ? *news.slot : known_.know(landmark.id);
  KnownLandmark& known = known_[slot];
  if (!news.slot) {
    known.last_near = differences_;
    near_.push_back(slot);
  }
  known.anchored = false;
  known.position = landmark.position;
  known.revision = landmark.revision;
  if (!news.describes) {
    update.moved_landmarks.push_back({landmark.id, landmark.position});
    return;
  }
  known.described = true;
  known.observations = static_cast<std::uint32_t>(landmark.observations.size());
  known.max_distance = landmark.max_distance;
  update.landmarks.push_back(state_of(landmark, news.shown_by));
}

void ClientView::take_back_the_farthest(MapUpdate& update) {
  if (known_.size() <= options_.max_known) return;
  const auto& slots = known_.slots();
  std::vector<Slot> candidates;
  for (Slot slot = 0; slot < slots.size(); ++slot)
    if (slots[slot].id.is_valid() && slots[slot].last_near < differences_)
      candidates.push_back(slot);
  // A tenth more than needed, so that this happens rarely.
  const std::size_t wanted = known_.size() - options_.max_known + options_.max_known / 10;
  const std::size_t count = std::min(wanted, candidates.size());
  std::sort(candidates.begin(), candidates.end(), [&](Slot a, Slot b) {
    return std::pair(slots[a].last_near, slots[a].id) < std::pair(slots[b].last_near, slots[b].id);
  });
  for (std::size_t i = 0; i < count; ++i) {
    update.removed_landmarks.push_back({slots[candidates[i]].id, std::nullopt});
    known_.forget(candidates[i]);
  }
}

}  // namespace cairn
