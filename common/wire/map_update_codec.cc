#include "common/wire/map_update_codec.h"

#include <cmath>
#include <iterator>
#include <string>
#include <unordered_set>
#include <utility>

#include "common/wire/envelope.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

// Fewest bytes that one entry of each list can take: what a claimed length is checked against.
constexpr std::size_t kMinPoseBytes = 2 + kRigidBytes;
constexpr std::size_t kMinKeyframeRemovalBytes = 4 + kRigidBytes;
constexpr std::size_t kMinLandmarkBytes = 2 + 12 + 6 + 8 + kDescriptorBytes + 1;
constexpr std::size_t kMinLandmarkRemovalBytes = 3;

constexpr double kMaxPosition = 1e7;       // metres
constexpr double kNormalTolerance = 1e-3;  // covers the rounding to 16 bits
constexpr double kNormalScale = 32767;

Status unsound(const std::string& what) {
  return {ErrorCode::kInvalidArgument, "map update: " + what};
}

template <typename List>
bool has_duplicates(const List& list) {
  std::unordered_set<decltype(list.front().id)> seen;
  for (const auto& entry : list)
    if (!seen.insert(entry.id).second) return true;
  return false;
}

bool is_sound(const LandmarkState& l) {
  if (!wire::is_sound(l.id) || l.observers.size() > LandmarkState::kMaxObservers) return false;
  // NaN fails each of these comparisons.
  if (!(l.position.cwiseAbs().maxCoeff() <= kMaxPosition) || !l.position.allFinite()) return false;
  const double norm = l.normal.norm();
  if (norm != 0 && !(std::abs(norm - 1) <= kNormalTolerance)) return false;
  if (!(l.min_distance >= 0 && l.min_distance <= l.max_distance && l.max_distance <= kMaxPosition))
    return false;
  for (const KeyframeId& id : l.observers)
    if (!id.is_valid()) return false;
  return true;
}

EpochTableWriter collect_epochs(const MapUpdate& update) {
  EpochTableWriter epochs;
  for (const auto& k : update.keyframes) epochs.add(k.id.epoch);
  for (const auto& r : update.removed_keyframes) {
    epochs.add(r.id.epoch);
    epochs.add(r.anchor.epoch);
  }
  for (const auto& l : update.landmarks) {
    epochs.add(l.id.origin);
    for (const KeyframeId& id : l.observers) epochs.add(id.epoch);
  }
  for (const auto& r : update.removed_landmarks) {
    epochs.add(r.id.origin);
    if (r.replaced_by) epochs.add(r.replaced_by->origin);
  }
  return epochs;
}

void put_head(ByteWriter& out, std::string_view client, const MapUpdate& update) {
  out.put_string(client);
  out.put(update.map.value);
  out.put(update.base_revision);
  out.put(update.revision);
  out.put(update.merge_epoch);
  out.put(update.epoch);
  out.put(update.mapped_keyframes);
  out.put(static_cast<std::uint8_t>(update.settled | update.landmarks_follow << 1));
  out.put(static_cast<std::uint8_t>(update.new_map_from_old_map.has_value()));
  if (const auto& moved = update.new_map_from_old_map) {
    put_rigid(out, {moved->rotation, moved->translation});
    out.put(moved->scale);
  }
}

bool get_head(ByteReader& in, DecodedMapUpdate& decoded) {
  MapUpdate& update = decoded.update;
  decoded.client = in.get_string();
  update.map.value = in.get<std::uint64_t>();
  update.base_revision = in.get<std::uint64_t>();
  update.revision = in.get<std::uint64_t>();
  update.merge_epoch = in.get<std::uint32_t>();
  update.epoch = in.get<std::uint64_t>();
  update.mapped_keyframes = in.get<std::uint32_t>();
  const auto flags = in.get<std::uint8_t>();
  if (flags > 3) return false;
  update.settled = (flags & 1) != 0;
  update.landmarks_follow = (flags & 2) != 0;
  const auto moved = in.get<std::uint8_t>();
  if (moved > 1) return false;
  if (moved == 1) {
    const Rigid3 rigid = get_rigid(in);
    update.new_map_from_old_map = Sim3(rigid.rotation, rigid.translation, in.get_double());
  }
  return in.ok();
}

void put_landmark(ByteWriter& out, const EpochTableWriter& epochs, const LandmarkState& l) {
  epochs.put(out, l.id);
  for (int i = 0; i < 3; ++i) out.put(static_cast<float>(l.position[i]));
  for (int i = 0; i < 3; ++i) {
    const auto q = static_cast<std::int16_t>(std::lround(l.normal[i] * kNormalScale));
    out.put(static_cast<std::uint16_t>(q));
  }
  out.put(l.min_distance);
  out.put(l.max_distance);
  put_descriptor(out, l.descriptor);
  out.put(static_cast<std::uint8_t>(l.observers.size()));
  for (const KeyframeId& id : l.observers) epochs.put(out, id);
}

LandmarkState get_landmark(ByteReader& in, const EpochTableReader& epochs) {
  LandmarkState l;
  l.id = epochs.get_landmark(in);
  for (int i = 0; i < 3; ++i) l.position[i] = in.get_float();
  for (int i = 0; i < 3; ++i)
    l.normal[i] = static_cast<std::int16_t>(in.get<std::uint16_t>()) / kNormalScale;
  l.min_distance = in.get_float();
  l.max_distance = in.get_float();
  l.descriptor = get_descriptor(in);
  const auto observers = in.get<std::uint8_t>();
  // One more than allowed is enough for the check to object.
  for (int i = 0; i < observers && i <= int{LandmarkState::kMaxObservers}; ++i)
    l.observers.push_back(epochs.get_keyframe(in));
  return l;
}

LandmarkRemoval get_landmark_removal(ByteReader& in, const EpochTableReader& epochs, bool& good) {
  LandmarkRemoval r;
  r.id = epochs.get_landmark(in);
  const auto replaced = in.get<std::uint8_t>();
  if (replaced == 1) r.replaced_by = epochs.get_landmark(in);
  good = good && replaced <= 1;
  return r;
}

// Reads a length and then that many entries with `get`.
template <typename Entry, typename Get>
bool get_list(ByteReader& in, std::size_t min_bytes, std::vector<Entry>& list, Get&& get) {
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, min_bytes)) return false;
  list.reserve(count);
  for (std::uint64_t i = 0; i < count && in.ok(); ++i) list.push_back(get());
  return in.ok();
}

bool get_lists(ByteReader& in, MapUpdate& update) {
  EpochTableReader epochs;
  bool good = epochs.read(in);
  good = good && get_list(in, kMinPoseBytes, update.keyframes, [&] {
           const KeyframeId id = epochs.get_keyframe(in);
           return KeyframePose{id, get_rigid(in)};
         });
  good = good && get_list(in, kMinKeyframeRemovalBytes, update.removed_keyframes, [&] {
           const KeyframeId id = epochs.get_keyframe(in);
           const KeyframeId anchor = epochs.get_keyframe(in);
           return KeyframeRemoval{id, anchor, get_rigid(in)};
         });
  good = good && get_list(in, kMinLandmarkBytes, update.landmarks,
                          [&] { return get_landmark(in, epochs); });
  bool flags_good = true;
  good = good && get_list(in, kMinLandmarkRemovalBytes, update.removed_landmarks,
                          [&] { return get_landmark_removal(in, epochs, flags_good); });
  return good && flags_good;
}

// Moves the entries of `list` from `next` on into `part` until `room` bytes are used up.
template <typename Entry, typename Size>
void fill(const std::vector<Entry>& list, std::size_t& next, std::vector<Entry>& part,
          std::ptrdiff_t& room, Size&& size_of) {
  while (next < list.size() && room > 0) {
    room -= static_cast<std::ptrdiff_t>(size_of(list[next]));
    part.push_back(list[next++]);
  }
}

template <typename Entry>
void append(std::vector<Entry>& to, std::vector<Entry>& from) {
  to.insert(to.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
}

}  // namespace

Status check_map_update(const MapUpdate& update) {
  if (update.map.value == 0) return unsound("map id is zero");
  if (update.epoch == 0) return unsound("epoch is zero");
  if (update.revision <= update.base_revision) return unsound("revision does not grow");
  if (update.new_map_from_old_map && !wire::is_sound(*update.new_map_from_old_map))
    return unsound("motion of the map is no similarity");
  for (const auto& k : update.keyframes)
    if (!k.id.is_valid() || !wire::is_sound(k.map_from_camera))
      return unsound("keyframe with an impossible id or pose");
  for (const auto& r : update.removed_keyframes)
    if (!r.id.is_valid() || !r.anchor.is_valid() || r.anchor == r.id ||
        !wire::is_sound(r.anchor_from_camera))
      return unsound("removed keyframe with an impossible id, anchor or pose");
  for (const auto& l : update.landmarks)
    if (!is_sound(l)) return unsound("landmark with an impossible id or value");
  for (const auto& r : update.removed_landmarks)
    if (!wire::is_sound(r.id) ||
        (r.replaced_by && (!wire::is_sound(*r.replaced_by) || *r.replaced_by == r.id)))
      return unsound("removed landmark with an impossible id");
  if (has_duplicates(update.keyframes) || has_duplicates(update.removed_keyframes) ||
      has_duplicates(update.landmarks) || has_duplicates(update.removed_landmarks))
    return unsound("an id stands twice in one list");
  return {};
}

Result<Blob> encode_map_update(std::string_view client, const MapUpdate& update) {
  if (Status s = check_client_name(client); !s) return s.error();
  if (Status s = check_map_update(update); !s) return s.error();
  const EpochTableWriter epochs = collect_epochs(update);
  ByteWriter out(256 + update.keyframes.size() * 70 + update.landmarks.size() * 100);
  put_head(out, client, update);
  epochs.put_table(out);
  out.put_varint(update.keyframes.size());
  for (const auto& k : update.keyframes) {
    epochs.put(out, k.id);
    put_rigid(out, k.map_from_camera);
  }
  out.put_varint(update.removed_keyframes.size());
  for (const auto& r : update.removed_keyframes) {
    epochs.put(out, r.id);
    epochs.put(out, r.anchor);
    put_rigid(out, r.anchor_from_camera);
  }
  out.put_varint(update.landmarks.size());
  for (const auto& l : update.landmarks) put_landmark(out, epochs, l);
  out.put_varint(update.removed_landmarks.size());
  for (const auto& r : update.removed_landmarks) {
    epochs.put(out, r.id);
    out.put(static_cast<std::uint8_t>(r.replaced_by.has_value()));
    if (r.replaced_by) epochs.put(out, *r.replaced_by);
  }
  if (out.size() > kMaxMapUpdateBytes - kEnvelopeSize)
    return unsound("too large, split it").error();
  return seal(kMapUpdateFormat, out.take());
}

Result<DecodedMapUpdate> decode_map_update(Bytes blob) {
  if (blob.size() > kMaxMapUpdateBytes) return Error{ErrorCode::kCorrupt, "map update: too large"};
  const Result<Bytes> payload = unseal(kMapUpdateFormat, blob);
  if (!payload) return payload.error();
  ByteReader in(*payload);
  DecodedMapUpdate decoded;
  if (!get_head(in, decoded) || !get_lists(in, decoded.update) || !in.at_end() ||
      !check_client_name(decoded.client))
    return Error{ErrorCode::kCorrupt, "map update: contents contradict the format"};
  if (Status s = check_map_update(decoded.update); !s)
    return Error{ErrorCode::kCorrupt, s.message()};
  return decoded;
}

std::vector<MapUpdate> split_map_update(const MapUpdate& update, std::uint64_t first_revision,
                                        std::size_t max_bytes) {
  std::vector<MapUpdate> parts;
  std::size_t k = 0, rk = 0, l = 0, rl = 0;
  do {
    MapUpdate part;
    part.map = update.map;
    part.merge_epoch = update.merge_epoch;
    part.epoch = update.epoch;
    part.mapped_keyframes = update.mapped_keyframes;
    part.settled = update.settled;
    part.landmarks_follow = update.landmarks_follow;
    part.base_revision = parts.empty() ? update.base_revision : parts.back().revision;
    part.revision = first_revision + parts.size();
    if (parts.empty()) part.new_map_from_old_map = update.new_map_from_old_map;
    // The head, the table of epochs and one entry too many fit into this margin.
    auto room = static_cast<std::ptrdiff_t>(max_bytes) - 1000;
    if (room < 1) room = 1;
    fill(update.keyframes, k, part.keyframes, room, [](const auto&) { return kRigidBytes + 8; });
    fill(update.removed_keyframes, rk, part.removed_keyframes, room,
         [](const auto&) { return kRigidBytes + 16; });
    fill(update.landmarks, l, part.landmarks, room, [](const LandmarkState& state) {
      return kMinLandmarkBytes + 10 + 7 * state.observers.size();
    });
    fill(update.removed_landmarks, rl, part.removed_landmarks, room,
         [](const auto&) { return std::size_t{25}; });
    parts.push_back(std::move(part));
  } while (k < update.keyframes.size() || rk < update.removed_keyframes.size() ||
           l < update.landmarks.size() || rl < update.removed_landmarks.size());
  return parts;
}

void append_part(MapUpdate& whole, MapUpdate part) {
  whole.revision = part.revision;
  whole.mapped_keyframes = part.mapped_keyframes;
  whole.settled = part.settled;
  append(whole.keyframes, part.keyframes);
  append(whole.removed_keyframes, part.removed_keyframes);
  append(whole.landmarks, part.landmarks);
  append(whole.removed_landmarks, part.removed_landmarks);
}

}  // namespace cairn::wire
