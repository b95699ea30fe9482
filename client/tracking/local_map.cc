#include "client/tracking/local_map.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace cairn {
namespace {

// A provisional landmark at `position` (in map), as a feature of a keyframe shows it.
LocalLandmark provisional_landmark(const Keyframe& keyframe, std::uint16_t feature, LandmarkId id,
                                   const Eigen::Vector3d& position, const Rigid3& map_from_camera) {
  const ScalePyramid& pyramid = keyframe.rig->pyramid;
  const Eigen::Vector3d to_camera = map_from_camera.origin() - position;
  LocalLandmark landmark;
  landmark.id = id;
  landmark.position = position;
  landmark.normal = to_camera.normalized();
  // Seen at octave o from this distance, it shows at octave 0 from scale(o) times as far.
  landmark.max_distance = static_cast<float>(
      to_camera.norm() * pyramid.scale(keyframe.features.points[feature].octave));
  landmark.min_distance =
      landmark.max_distance / static_cast<float>(pyramid.scale(pyramid.levels - 1));
  landmark.descriptor = keyframe.features.descriptors[feature];
  landmark.anchor = keyframe.id;
  return landmark;
}

// From one feature with depth.
LocalLandmark landmark_from_feature(const Keyframe& keyframe, std::uint16_t feature,
                                    const Rigid3& map_from_camera) {
  const PinholeCamera& camera = keyframe.rig->camera;
  const Feature& f = keyframe.features.points[feature];
  return provisional_landmark(
      keyframe, feature, LandmarkId::from_feature(keyframe.id, feature),
      map_from_camera * camera.unproject(f.pixel(), camera.depth(f.disparity)), map_from_camera);
}

void move_landmark(const Sim3& move, LocalLandmark& landmark) {
  landmark.position = move * landmark.position;
  landmark.normal = move.rotation * landmark.normal;
  landmark.min_distance *= static_cast<float>(move.scale);
  landmark.max_distance *= static_cast<float>(move.scale);
}

}  // namespace

const LocalLandmark* LocalMap::find(LandmarkId id) const {
  const auto slot = slot_of(id);
  return slot ? &slots_[*slot] : nullptr;
}

std::optional<LocalMap::Slot> LocalMap::slot_of(LandmarkId id) const {
  const auto it = by_id_.find(current_name(id));
  if (it == by_id_.end()) return std::nullopt;
  return it->second;
}

std::vector<std::pair<KeyframeId, int>> LocalMap::votes(std::span<const LandmarkId> seen) const {
  std::unordered_map<KeyframeId, int> counts;
  for (const LandmarkId id : seen)
    if (const LocalLandmark* landmark = find(id))
      for (const KeyframeId observer : landmark->observers) ++counts[observer];
  std::vector<std::pair<KeyframeId, int>> sorted(counts.begin(), counts.end());
  // Ties go to the newer keyframe: it looks more like what is in view now.
  std::sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : a.first > b.first;
  });
  return sorted;
}

std::vector<const LocalLandmark*> LocalMap::around(std::span<const LandmarkId> seen,
                                                   std::size_t max_keyframes) {
  ++queries_;
  std::vector<const LocalLandmark*> found;
  const auto take = [&](Slot slot) {
    if (mark_[slot] == queries_) return;
    mark_[slot] = queries_;
    slots_[slot].last_use = queries_;
    found.push_back(&slots_[slot]);
  };
  for (const LandmarkId id : seen)
    if (const auto slot = slot_of(id)) take(*slot);
  auto candidates = votes(seen);
  if (candidates.size() > max_keyframes) candidates.resize(max_keyframes);
  for (const auto& [keyframe, count] : candidates)
    if (const auto it = seen_by_.find(keyframe); it != seen_by_.end())
      for (const Slot slot : it->second) take(slot);
  return found;
}

std::optional<KeyframeId> LocalMap::most_shared(std::span<const LandmarkId> seen) const {
  for (const auto& [keyframe, count] : votes(seen))
    if (own(keyframe)) return keyframe;
  return std::nullopt;
}

int LocalMap::landmarks_of(KeyframeId keyframe) const {
  const auto it = seen_by_.find(keyframe);
  return it == seen_by_.end() ? 0 : static_cast<int>(it->second.size());
}

LocalMap::Slot LocalMap::insert(LocalLandmark landmark) {
  Slot slot;
  if (free_slots_.empty()) {
    slot = static_cast<Slot>(slots_.size());
    slots_.emplace_back();
    mark_.push_back(0);
  } else {
    slot = free_slots_.back();
    free_slots_.pop_back();
  }
  landmark.last_use = queries_;
  const std::vector<KeyframeId> observers = std::exchange(landmark.observers, {});
  by_id_[landmark.id] = slot;
  slots_[slot] = std::move(landmark);
  for (const KeyframeId observer : observers) observe(slot, observer);
  return slot;
}

void LocalMap::observe(Slot slot, KeyframeId keyframe) {
  auto& observers = slots_[slot].observers;
  if (std::find(observers.begin(), observers.end(), keyframe) != observers.end()) return;
  observers.push_back(keyframe);
  seen_by_[keyframe].push_back(slot);
}

// Views of one place would add up for as long as the client stays there. Where others lead to a
// landmark, one that the server has culled is not needed.
void LocalMap::forget_needless_views(KeyframeId culled) {
  constexpr std::size_t kEnough = 8;
  const auto seen = seen_by_.find(culled);
  if (seen == seen_by_.end()) return;
  std::erase_if(seen->second, [&](Slot slot) {
    auto& observers = slots_[slot].observers;
    return observers.size() > kEnough && std::erase(observers, culled) > 0;
  });
  if (seen->second.empty()) seen_by_.erase(seen);
}

void LocalMap::remove(LandmarkId id) {
  const auto slot = slot_of(id);
  if (!slot) return;
  for (const KeyframeId observer : slots_[*slot].observers) {
    const auto it = seen_by_.find(observer);
    std::erase(it->second, *slot);
    if (it->second.empty()) seen_by_.erase(it);
  }
  by_id_.erase(slots_[*slot].id);
  slots_[*slot] = LocalLandmark{};
  free_slots_.push_back(*slot);
}

LandmarkId LocalMap::current_name(LandmarkId id) const {
  for (auto it = renamed_.find(id); it != renamed_.end(); it = renamed_.find(id)) id = it->second;
  return id;
}

void LocalMap::rename(LandmarkId from, LandmarkId to) {
  if (current_name(to) == from || renamed_.contains(from))
    return;  // would make a circle, or is old
  const auto old_slot = slot_of(from), new_slot = slot_of(to);
  if (old_slot && new_slot && *old_slot == *new_slot) return;
  if (old_slot && new_slot)
    for (const KeyframeId observer : std::vector(slots_[*old_slot].observers))
      observe(*new_slot, observer);
  remove(from);
  renamed_[from] = to;
  renamed_in_order_.push_back(from);
  // What has lost its name so long ago nobody asks for any more.
  for (; renamed_in_order_.size() > limits_.former_names; renamed_in_order_.pop_front())
    renamed_.erase(renamed_in_order_.front());
}

void LocalMap::add_keyframe(KeyframePtr keyframe, const Rigid3& map_from_camera) {
  for (const LandmarkMatch& match : keyframe->matches) {
    const bool makes = match.landmark == LandmarkId::from_feature(keyframe->id, match.feature);
    const auto slot = makes
                          ? insert(landmark_from_feature(*keyframe, match.feature, map_from_camera))
                          : slot_of(match.landmark);
    if (slot) observe(*slot, keyframe->id);
  }
  OwnKeyframe mine;
  mine.id = keyframe->id;
  mine.map_from_camera = map_from_camera;
  mine.reference = mine.tracked_against = keyframe->reference;
  mine.reference_from_camera = keyframe->reference_from_camera;
  mine.keyframe = std::move(keyframe);
  keyframes_.push_back(std::move(mine));
  let_features_go();
  enforce_limits();
}

void LocalMap::let_features_go() {
  const std::size_t made = keyframes_.size();
  const std::size_t lag =
      std::min(made - std::min(made, mapped_keyframes_), limits_.unmapped_with_features);
  for (; made - first_with_features_ > limits_.keyframes_with_features + lag;
       ++first_with_features_)
    keyframes_[first_with_features_].keyframe.reset();
}

void LocalMap::add_landmark(const Keyframe& keyframe, const ProvisionalLandmark& made) {
  if (slot_of(made.id)) return;
  const Slot slot = insert(provisional_landmark(keyframe, made.feature, made.id, made.position,
                                                keyframes_.back().map_from_camera.pose()));
  observe(slot, made.id.creator());
  observe(slot, keyframe.id);
}

void LocalMap::apply(const MapUpdate& update) {
  if (update.new_map_from_old_map) move(*update.new_map_from_old_map);
  id_ = update.map;
  if (update.is_refresh()) forget_servers_landmarks(update);
  std::unordered_map<KeyframeId, Sim3> old_poses;
  for (const OwnKeyframe& k : keyframes_) old_poses[k.id] = k.map_from_camera;

  place_keyframes(update);
  if (!keyframes_.empty() && update.epoch == keyframes_.front().id.epoch)
    mapped_keyframes_ = std::max<std::size_t>(mapped_keyframes_, update.mapped_keyframes);
  if (!update.parts.empty()) {
    told_parts_ = update.parts;
    told_of_ = update.mapped_keyframes;
  }
  let_features_go();

  // Provisional landmarks keep their place relative to the keyframe that made them. A loop moves
  // more landmarks than one update tells of: until they are told, they follow keyframes too.
  for (const auto& [id, slot] : by_id_) {
    LocalLandmark& landmark = slots_[slot];
    const OwnKeyframe* moves_with = own(landmark.anchor);
    if (!landmark.anchor.is_valid() && update.landmarks_follow)
      moves_with = first_own_observer(landmark);
    if (!moves_with) continue;
    move_landmark(moves_with->map_from_camera * old_poses[moves_with->id].inverse(), landmark);
    if (is_known_to_server(landmark, update)) landmark.anchor = {};
  }
  for (const LandmarkState& state : update.landmarks) update_landmark(state);
  for (const LandmarkMove& move : update.moved_landmarks)
    if (const auto slot = slot_of(move.id)) {
      slots_[*slot].position = move.position;
      slots_[*slot].anchor = {};
    }
  for (const LandmarkRemoval& removal : update.removed_landmarks) {
    if (removal.replaced_by)
      rename(removal.id, *removal.replaced_by);
    else
      remove(removal.id);
  }
  enforce_limits();
}

// The server moves a landmark with the keyframe that made it.
const LocalMap::OwnKeyframe* LocalMap::first_own_observer(const LocalLandmark& landmark) const {
  const OwnKeyframe* first = nullptr;
  for (const KeyframeId observer : landmark.observers)
    if (const OwnKeyframe* k = own(observer); k && (!first || k->id < first->id)) first = k;
  return first;
}

void LocalMap::move(const Sim3& new_map_from_old_map) {
  for (OwnKeyframe& k : keyframes_) k.map_from_camera = new_map_from_old_map * k.map_from_camera;
  for (const auto& [id, slot] : by_id_) move_landmark(new_map_from_old_map, slots_[slot]);
}

NewNames LocalMap::change_map(const Sim3& new_map_from_old_map) {
  move(new_map_from_old_map);
  NewNames names = take_over_landmarks();
  for (OwnKeyframe& k : keyframes_) take_over_keyframe(k, names);
  return names;
}

// Each landmark becomes provisional, by the last own keyframe that sees it.
NewNames LocalMap::take_over_landmarks() {
  std::vector<std::pair<LandmarkId, Slot>> all(by_id_.begin(), by_id_.end());
  std::sort(all.begin(), all.end());
  // No feature has so high a number: the server can't take the name for another landmark's.
  std::uint16_t next_name = std::numeric_limits<std::uint16_t>::max();
  NewNames names;
  for (const auto& [id, slot] : all) {
    LocalLandmark& landmark = slots_[slot];
    KeyframeId anchor = id.origin == LandmarkId::kServer ? KeyframeId{} : id.creator();
    if (!own(anchor))
      for (const KeyframeId observer : landmark.observers)
        if (own(observer)) anchor = observer;
    if (!own(anchor)) {
      names.add(id, {});
      remove(id);
      continue;
    }
    landmark.anchor = anchor;
    if (id.origin != LandmarkId::kServer) continue;
    landmark.id = LandmarkId::from_feature(anchor, next_name--);
    by_id_.erase(id);
    by_id_[landmark.id] = slot;
    names.add(id, landmark.id);
  }
  for (const auto& [before, replacement] : renamed_)
    names.add(before, names.of(current_name(replacement)));
  renamed_.clear();
  renamed_in_order_.clear();
  return names;
}

void LocalMap::take_over_keyframe(OwnKeyframe& mine, const NewNames& names) const {
  if (mine.placed_by_server) mine.reference = {};
  mine.placed_by_server = false;
  mine.of_former_map = true;
  if (!mine.keyframe) return;
  auto renamed = std::make_shared<Keyframe>(*mine.keyframe);
  for (LandmarkMatch& match : renamed->matches) match.landmark = names.of(match.landmark);
  std::erase_if(renamed->matches, [](const LandmarkMatch& m) { return !m.landmark.is_valid(); });
  mine.keyframe = std::move(renamed);
}

bool LocalMap::is_known_to_server(const LocalLandmark& landmark, const MapUpdate& update) const {
  const OwnKeyframe* anchor = own(landmark.anchor);
  return !anchor || (anchor->id.sequence < update.mapped_keyframes && !anchor->of_former_map);
}

// What the server has mapped and does not tell of any more is gone; what it has not mapped yet is
// the client's own.
void LocalMap::forget_servers_landmarks(const MapUpdate& update) {
  renamed_.clear();
  renamed_in_order_.clear();
  std::vector<LandmarkId> known;
  for (const auto& [id, slot] : by_id_) {
    if (is_known_to_server(slots_[slot], update)) known.push_back(id);
  }
  for (const LandmarkId id : known) remove(id);
}

void LocalMap::place_keyframes(const MapUpdate& update) {
  for (const KeyframePose& pose : update.keyframes)
    if (OwnKeyframe* k = own(pose.id)) {
      k->map_from_camera = pose.map_from_camera;
      k->placed_by_server = true;
      k->of_former_map = false;
      k->reference = {};
    }
  for (const KeyframeRemoval& removal : update.removed_keyframes)
    if (OwnKeyframe* k = own(removal.id)) {
      k->reference = removal.anchor;
      k->reference_from_camera = removal.anchor_from_camera;
      k->placed_by_server = false;
      k->of_former_map = false;
      forget_needless_views(removal.id);
    }
  // An anchor may be younger than what hangs on it (a culled keyframe's parent), so that one pass
  // in order of sequence is not enough. Each is followed once, up to one that has been.
  std::vector<std::uint8_t> followed(keyframes_.size(), 0);
  std::vector<OwnKeyframe*> chain;
  for (OwnKeyframe& k : keyframes_) {
    for (OwnKeyframe* at = &k; at && !at->placed_by_server; at = own(at->reference)) {
      std::uint8_t& was_followed = followed[static_cast<std::size_t>(at - keyframes_.data())];
      if (was_followed != 0) break;
      was_followed = 1;
      chain.push_back(at);
    }
    for (; !chain.empty(); chain.pop_back())
      if (const OwnKeyframe* reference = own(chain.back()->reference))
        chain.back()->map_from_camera =
            reference->map_from_camera * chain.back()->reference_from_camera;
  }
}

// Null where it is that of a feature which is held no longer.
const Descriptor* LocalMap::descriptor_of(const LandmarkState& state) const {
  if (!state.shown_by) return &state.descriptor;
  if (state.shown_by->sequence >= keyframes_.size()) return nullptr;
  const KeyframePtr& keyframe = keyframes_[state.shown_by->sequence].keyframe;
  if (!keyframe || state.shown_by->feature >= keyframe->features.size()) return nullptr;
  return &keyframe->features.descriptors[state.shown_by->feature];
}

void LocalMap::update_landmark(const LandmarkState& state) {
  renamed_.erase(state.id);  // the server uses the name again
  const Descriptor* descriptor = descriptor_of(state);
  auto slot = slot_of(state.id);
  if (!slot) {
    if (!descriptor) return;
    LocalLandmark landmark;
    landmark.id = state.id;
    slot = insert(std::move(landmark));
  }
  LocalLandmark& landmark = slots_[*slot];
  landmark.position = state.position;
  landmark.normal = state.normal;
  landmark.min_distance = state.min_distance;
  landmark.max_distance = state.max_distance;
  if (descriptor) landmark.descriptor = *descriptor;
  landmark.anchor = {};
  for (const KeyframeId observer : state.observers) observe(*slot, observer);
}

void LocalMap::enforce_limits() {
  if (by_id_.size() <= limits_.landmarks) return;
  std::vector<Slot> by_use;
  by_use.reserve(by_id_.size());
  for (const auto& [id, slot] : by_id_) by_use.push_back(slot);
  std::sort(by_use.begin(), by_use.end(), [&](Slot a, Slot b) {
    return std::pair(slots_[a].last_use, slots_[a].id) <
           std::pair(slots_[b].last_use, slots_[b].id);
  });
  // A tenth more than needed, so that this happens rarely.
  const std::size_t drop = by_id_.size() - limits_.landmarks + limits_.landmarks / 10;
  for (std::size_t i = 0; i < drop; ++i) remove(slots_[by_use[i]].id);
}

LocalMap::OwnKeyframe* LocalMap::own(KeyframeId id) {
  return const_cast<OwnKeyframe*>(std::as_const(*this).own(id));
}

const LocalMap::OwnKeyframe* LocalMap::own(KeyframeId id) const {
  if (id.sequence >= keyframes_.size() || keyframes_[id.sequence].id != id) return nullptr;
  return &keyframes_[id.sequence];
}

std::optional<Rigid3> LocalMap::pose_of(KeyframeId keyframe) const {
  const OwnKeyframe* k = own(keyframe);
  if (!k) return std::nullopt;
  return k->map_from_camera.pose();
}

std::optional<Sim3> LocalMap::scaled_pose_of(KeyframeId keyframe) const {
  const OwnKeyframe* k = own(keyframe);
  if (!k) return std::nullopt;
  return k->map_from_camera;
}

std::vector<std::uint32_t> LocalMap::parts() const {
  std::vector<std::uint32_t> parts;
  std::uint32_t next = 0;
  for (const PartOfRun& run : told_parts_) next = std::max(next, run.part + 1);
  auto run = told_parts_.begin();
  for (const OwnKeyframe& k : keyframes_) {
    const std::uint32_t sequence = k.id.sequence;
    if (sequence < told_of_) {
      while (run + 1 != told_parts_.end() && (run + 1)->first <= sequence) ++run;
      parts.push_back(run->part);
    } else {
      parts.push_back(own(k.tracked_against) ? parts[k.tracked_against.sequence] : next++);
    }
  }
  return parts;
}

std::vector<KeyframePtr> LocalMap::recent_keyframes() const {
  std::vector<KeyframePtr> recent;
  for (auto k = keyframes_.rbegin();
       k != keyframes_.rend() && k->keyframe && recent.size() < limits_.keyframes_with_features;
       ++k)
    recent.push_back(k->keyframe);
  return recent;
}

std::vector<KeyframePtr> LocalMap::keyframes_sharing(std::span<const LandmarkId> seen,
                                                     std::size_t count) const {
  std::vector<KeyframePtr> sharing;
  for (const auto& [id, shared] : votes(seen)) {
    const OwnKeyframe* k = own(id);
    if (k && k->keyframe && sharing.size() < count) sharing.push_back(k->keyframe);
  }
  return sharing;
}

std::vector<LandmarkId> LocalMap::landmarks_by_feature(const Keyframe& keyframe) const {
  std::vector<LandmarkId> ids(keyframe.features.size());
  // A later keyframe may have made a landmark of one of this one's features.
  if (keyframe.rig->sensor == Sensor::kMono)
    for (std::size_t f = 0; f < ids.size(); ++f)
      if (const LocalLandmark* landmark =
              find(LandmarkId::from_feature(keyframe.id, static_cast<std::uint16_t>(f))))
        ids[f] = landmark->id;
  for (const LandmarkMatch& match : keyframe.matches)
    if (const LocalLandmark* landmark = find(match.landmark)) ids[match.feature] = landmark->id;
  return ids;
}

}  // namespace cairn
