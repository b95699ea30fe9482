#include "common/wire/map_update_codec.h"

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>

#include "common/wire/envelope.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/rounding.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

// Fewest bytes that one entry of each list can take: what a claimed length is checked against.
constexpr std::size_t kMinPoseBytes = 2 + kPoseBytes;
constexpr std::size_t kMinPartBytes = 2;
constexpr std::size_t kMinKeyframeRemovalBytes = 4 + kPoseBytes;
constexpr std::size_t kMinMoveBytes = 1 + kPointBytes;
constexpr std::size_t kMinLandmarkBytes = kMinMoveBytes + kNormalBytes + kRangeBytes + 3;
constexpr std::size_t kMinLandmarkRemovalBytes = 2;

// What one takes in a list of many, as a rule; and at most.
constexpr std::size_t kUsualIdBytes = 2, kMostIdBytes = 20;
constexpr std::size_t kUnitBytes = 4, kMostPartBytes = 10;

// What a landmark's state has after its range: how many observers, and whether a feature of the
// client's own shows it.
constexpr std::uint8_t kObserversMask = 0x7, kShownBy = 0x8;
static_assert(LandmarkState::kMaxObservers <= kObserversMask);

EpochTableWriter collect_epochs(const MapUpdate& update) {
  EpochTableWriter epochs;
  for (const auto& k : update.keyframes) epochs.add(k.id.epoch);
  for (const auto& r : update.removed_keyframes) {
    epochs.add(r.id.epoch);
    epochs.add(r.anchor.epoch);
  }
  for (const auto& l : update.landmarks) {
    epochs.add(l.id.origin);
    for (const KeyframeId& id : l.observers)
      if (id.epoch != update.epoch) epochs.add(id.epoch);
  }
  for (const auto& l : update.moved_landmarks) epochs.add(l.id.origin);
  for (const auto& r : update.removed_landmarks) {
    epochs.add(r.id.origin);
    if (r.replaced_by) epochs.add(r.replaced_by->origin);
  }
  return epochs;
}

// With depth, and before the first change of scale, every unit is the map's.
bool is_unit_told(const Sim3& pose) {
  return static_cast<float>(pose.scale) != 1.0f;
}

bool tells_units(const MapUpdate& update) {
  return std::any_of(update.keyframes.begin(), update.keyframes.end(),
                     [](const auto& k) { return is_unit_told(k.map_from_camera); }) ||
         std::any_of(update.removed_keyframes.begin(), update.removed_keyframes.end(),
                     [](const auto& r) { return is_unit_told(r.anchor_from_camera); });
}

void put_scaled_pose(ByteWriter& out, const Sim3& pose, const Eigen::Vector3d& centre, bool unit) {
  put_pose(out, pose.pose(), centre);
  if (unit) out.put(static_cast<float>(pose.scale));
}

Sim3 get_scaled_pose(ByteReader& in, const Eigen::Vector3d& centre, bool unit) {
  Sim3 pose = get_pose(in, centre);
  if (unit) pose.scale = in.get_float();
  return pose;
}

void put_head(ByteWriter& out, std::string_view client, const MapUpdate& update) {
  out.put_string(client);
  out.put(update.map.value);
  out.put(update.base_revision);
  out.put(update.revision);
  out.put(update.merge_epoch);
  out.put(update.epoch);
  out.put(update.mapped_keyframes);
  out.put(static_cast<std::uint8_t>(update.settled | update.landmarks_follow << 1 |
                                    tells_units(update) << 2));
  out.put(static_cast<std::uint8_t>(update.new_map_from_old_map.has_value()));
  if (const auto& moved = update.new_map_from_old_map) {
    put_similarity(out, *moved);
  }
  for (int i = 0; i < 3; ++i) out.put(update.centre[i]);
}

// `units`: whether poses are followed by the size of the keyframe's own unit.
bool get_head(ByteReader& in, DecodedMapUpdate& decoded, bool& units) {
  MapUpdate& update = decoded.update;
  decoded.client = in.get_string();
  update.map.value = in.get<std::uint64_t>();
  update.base_revision = in.get<std::uint64_t>();
  update.revision = in.get<std::uint64_t>();
  update.merge_epoch = in.get<std::uint32_t>();
  update.epoch = in.get<std::uint64_t>();
  update.mapped_keyframes = in.get<std::uint32_t>();
  const auto flags = in.get<std::uint8_t>();
  if (flags > 7) return false;
  update.settled = (flags & 1) != 0;
  update.landmarks_follow = (flags & 2) != 0;
  units = (flags & 4) != 0;
  const auto moved = in.get<std::uint8_t>();
  if (moved > 1) return false;
  if (moved == 1) update.new_map_from_old_map = get_similarity(in);
  for (int i = 0; i < 3; ++i) update.centre[i] = in.get_double();
  // Before points are made of it.
  return in.ok() && update.centre.allFinite();
}

// Keyframes of the client's own are told by how far they lie behind the newest mapped one.
std::uint64_t behind(const MapUpdate& update, std::uint32_t sequence) {
  return zigzag(std::int64_t{update.mapped_keyframes} - sequence);
}

// Not valid when there can be no such keyframe.
KeyframeId own_keyframe(const MapUpdate& update, std::uint64_t behind) {
  if (behind > std::uint64_t{1} << 33) return {};
  const std::int64_t sequence = std::int64_t{update.mapped_keyframes} - unzigzag(behind);
  if (sequence < 0 || sequence > std::int64_t{UINT32_MAX}) return {};
  return {update.epoch, static_cast<std::uint32_t>(sequence)};
}

// The lowest bit tells whether it is another client's keyframe.
void put_observer(ByteWriter& out, const MapUpdate& update, const EpochTableWriter& epochs,
                  KeyframeId id) {
  if (id.epoch == update.epoch) {
    out.put_varint(behind(update, id.sequence) << 1);
  } else {
    out.put_varint(std::uint64_t{epochs.place(id.epoch)} << 1 | 1);
    out.put_varint(id.sequence);
  }
}

// Not valid when malformed.
KeyframeId get_observer(ByteReader& in, const MapUpdate& update, const EpochTableReader& epochs) {
  const std::uint64_t code = in.get_varint();
  if ((code & 1) == 0) return in.ok() ? own_keyframe(update, code >> 1) : KeyframeId{};
  const auto epoch = epochs.epoch(code >> 1);
  const std::uint64_t sequence = in.get_varint();
  if (!epoch || !in.ok() || sequence > UINT32_MAX) return {};
  return {*epoch, static_cast<std::uint32_t>(sequence)};
}

void put_landmark(ByteWriter& out, const MapUpdate& update, const EpochTableWriter& epochs,
                  const LandmarkState& l) {
  put_point(out, l.position, update.centre);
  put_normal(out, l.normal);
  put_range(out, l.min_distance, l.max_distance);
  out.put(static_cast<std::uint8_t>(l.observers.size() | (l.shown_by ? kShownBy : 0)));
  if (l.shown_by) {
    out.put_varint(behind(update, l.shown_by->sequence));
    out.put_varint(l.shown_by->feature);
  } else {
    put_descriptor(out, l.descriptor);
  }
  for (const KeyframeId& id : l.observers) put_observer(out, update, epochs, id);
}

// False when malformed; what has no sound value is left to the check.
bool get_landmark(ByteReader& in, const MapUpdate& update, const EpochTableReader& epochs,
                  LandmarkState& l) {
  l.position = get_point(in, update.centre);
  l.normal = get_normal(in);
  get_range(in, l.min_distance, l.max_distance);
  const auto head = in.get<std::uint8_t>();
  if ((head & ~(kObserversMask | kShownBy)) != 0) return false;
  if ((head & kShownBy) != 0) {
    const KeyframeId keyframe = own_keyframe(update, in.get_varint());
    const std::uint64_t feature = in.get_varint();
    if (!keyframe.is_valid() || feature >= kMaxFeatures) return false;
    l.shown_by = {keyframe.sequence, static_cast<std::uint16_t>(feature)};
  } else {
    l.descriptor = get_descriptor(in);
  }
  for (int i = 0; i < (head & kObserversMask); ++i)
    l.observers.push_back(get_observer(in, update, epochs));
  return in.ok();
}

bool get_landmark_removal(ByteReader& in, const EpochTableReader& epochs, LandmarkRemoval& r) {
  const auto replaced = in.get<std::uint8_t>();
  if (replaced == 1) r.replaced_by = epochs.get_landmark(in);
  return replaced <= 1;
}

// Reads a length and then that many entries with `get`, which tells whether the entry is one.
template <typename Entry, typename Get>
bool get_list(ByteReader& in, std::size_t min_bytes, std::vector<Entry>& list, Get&& get) {
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, min_bytes)) return false;
  list.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i)
    if (!get(list.emplace_back()) || !in.ok()) return false;
  return in.ok();
}

// The same for entries that begin with a landmark's id.
template <typename Entry, typename Get>
bool get_landmark_list(ByteReader& in, const EpochTableReader& epochs, std::size_t min_bytes,
                       std::vector<Entry>& list, Get&& get) {
  AscendingIdsReader ids(epochs);
  return get_list(in, min_bytes, list, [&](Entry& entry) {
    entry.id = ids.get(in);
    return get(entry);
  });
}

bool get_lists(ByteReader& in, bool units, MapUpdate& update) {
  EpochTableReader epochs;
  if (!epochs.read(in)) return false;
  const bool keyframes = get_list(in, kMinPoseBytes, update.keyframes, [&](KeyframePose& k) {
    k.id = epochs.get_keyframe(in);
    k.map_from_camera = get_scaled_pose(in, update.centre, units);
    return true;
  });
  const auto get_removal = [&](KeyframeRemoval& r) {
    r.id = epochs.get_keyframe(in);
    r.anchor = epochs.get_keyframe(in);
    r.anchor_from_camera = get_scaled_pose(in, Eigen::Vector3d::Zero(), units);
    return true;
  };
  const auto get_part = [&](PartOfRun& p) {
    const std::uint64_t first = in.get_varint(), part = in.get_varint();
    p = {static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(part)};
    return std::max(first, part) <= UINT32_MAX;
  };
  if (!keyframes ||
      !get_list(in, kMinKeyframeRemovalBytes, update.removed_keyframes, get_removal) ||
      !get_list(in, kMinPartBytes, update.parts, get_part))
    return false;
  const bool landmarks =
      get_landmark_list(in, epochs, kMinLandmarkBytes, update.landmarks,
                        [&](LandmarkState& l) { return get_landmark(in, update, epochs, l); });
  return landmarks &&
         get_landmark_list(in, epochs, kMinMoveBytes, update.moved_landmarks,
                           [&](LandmarkMove& l) {
                             l.position = get_point(in, update.centre);
                             return true;
                           }) &&
         get_landmark_list(in, epochs, kMinLandmarkRemovalBytes, update.removed_landmarks,
                           [&](LandmarkRemoval& r) { return get_landmark_removal(in, epochs, r); });
}

// Writes a length and then each entry with `put`.
template <typename Entry, typename Put>
void put_list(ByteWriter& out, const std::vector<Entry>& list, Put&& put) {
  out.put_varint(list.size());
  for (const Entry& entry : list) put(entry);
}

template <typename Entry, typename Put>
void put_landmark_list(ByteWriter& out, const EpochTableWriter& epochs,
                       const std::vector<Entry>& list, Put&& put) {
  AscendingIdsWriter ids(epochs);
  put_list(out, list, [&](const Entry& entry) {
    ids.put(out, entry.id);
    put(entry);
  });
}

void put_lists(ByteWriter& out, const MapUpdate& update) {
  const EpochTableWriter epochs = collect_epochs(update);
  const bool units = tells_units(update);
  epochs.put_table(out);
  put_list(out, update.keyframes, [&](const KeyframePose& k) {
    epochs.put(out, k.id);
    put_scaled_pose(out, k.map_from_camera, update.centre, units);
  });
  put_list(out, update.removed_keyframes, [&](const KeyframeRemoval& r) {
    epochs.put(out, r.id);
    epochs.put(out, r.anchor);
    put_scaled_pose(out, r.anchor_from_camera, Eigen::Vector3d::Zero(), units);
  });
  put_list(out, update.parts, [&](const PartOfRun& p) {
    out.put_varint(p.first);
    out.put_varint(p.part);
  });
  put_landmark_list(out, epochs, update.landmarks,
                    [&](const LandmarkState& l) { put_landmark(out, update, epochs, l); });
  put_landmark_list(out, epochs, update.moved_landmarks,
                    [&](const LandmarkMove& l) { put_point(out, l.position, update.centre); });
  put_landmark_list(out, epochs, update.removed_landmarks, [&](const LandmarkRemoval& r) {
    out.put(static_cast<std::uint8_t>(r.replaced_by.has_value()));
    if (r.replaced_by) epochs.put(out, *r.replaced_by);
  });
}

std::size_t most_bytes(const LandmarkState& l) {
  return kMinLandmarkBytes + kMostIdBytes + kDescriptorBytes + 12 * l.observers.size();
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

Result<Blob> encode_map_update(std::string_view client, const MapUpdate& update) {
  if (Status s = check_client_name(client); !s) return s.error();
  if (Status s = check_map_update(update); !s) return s.error();
  ByteWriter out(256 + update.keyframes.size() * 24 + update.landmarks.size() * 60 +
                 update.moved_landmarks.size() * 8 + update.removed_landmarks.size() * 4);
  put_head(out, client, update);
  put_lists(out, update);
  if (out.size() > kMaxMapUpdateBytes - kEnvelopeSize)
    return Error{ErrorCode::kInvalidArgument, "map update: too large, split it"};
  return seal(kMapUpdateFormat, out.take());
}

std::size_t usual_bytes(const LandmarkState& l) {
  const std::size_t look = l.shown_by ? 3 : kDescriptorBytes;
  return kUsualIdBytes + kPointBytes + kNormalBytes + kRangeBytes + 1 + look + l.observers.size();
}

std::size_t usual_bytes(const LandmarkMove&) {
  return kUsualIdBytes + kPointBytes;
}

std::size_t encoded_bytes(std::string_view client, const MapUpdate& update) {
  ByteWriter out(256 + update.landmarks.size() * 60 + update.moved_landmarks.size() * 8);
  put_head(out, client, update);
  put_lists(out, update);
  return kEnvelopeSize + out.size();
}

Result<DecodedMapUpdate> decode_map_update(Bytes blob) {
  if (blob.size() > kMaxMapUpdateBytes) return Error{ErrorCode::kCorrupt, "map update: too large"};
  const Result<Bytes> payload = unseal(kMapUpdateFormat, blob);
  if (!payload) return payload.error();
  ByteReader in(*payload);
  DecodedMapUpdate decoded;
  bool units = false;
  if (!get_head(in, decoded, units) || !get_lists(in, units, decoded.update) || !in.at_end() ||
      !check_client_name(decoded.client))
    return Error{ErrorCode::kCorrupt, "map update: contents contradict the format"};
  if (Status s = check_map_update(decoded.update); !s)
    return Error{ErrorCode::kCorrupt, s.message()};
  return decoded;
}

std::vector<MapUpdate> split_map_update(const MapUpdate& update, std::uint64_t first_revision,
                                        std::size_t max_bytes) {
  std::vector<MapUpdate> parts;
  struct {
    std::size_t keyframes = 0, removed_keyframes = 0;
    std::size_t landmarks = 0, moved_landmarks = 0, removed_landmarks = 0;
  } next;
  do {
    MapUpdate part;
    part.map = update.map;
    part.merge_epoch = update.merge_epoch;
    part.epoch = update.epoch;
    part.mapped_keyframes = update.mapped_keyframes;
    part.settled = update.settled;
    part.landmarks_follow = update.landmarks_follow;
    part.centre = update.centre;
    part.base_revision = parts.empty() ? update.base_revision : parts.back().revision;
    part.revision = first_revision + parts.size();
    if (parts.empty()) {
      part.new_map_from_old_map = update.new_map_from_old_map;
      part.parts = update.parts;
    }
    // The head, the table of epochs and one entry too many fit into this margin.
    auto room = static_cast<std::ptrdiff_t>(max_bytes) - 1000 -
                static_cast<std::ptrdiff_t>(kMostPartBytes * part.parts.size());
    if (room < 1) room = 1;
    fill(update.keyframes, next.keyframes, part.keyframes, room,
         [](const auto&) { return kPoseBytes + kUnitBytes + 8; });
    fill(update.removed_keyframes, next.removed_keyframes, part.removed_keyframes, room,
         [](const auto&) { return kPoseBytes + kUnitBytes + 16; });
    fill(update.landmarks, next.landmarks, part.landmarks, room, most_bytes);
    fill(update.moved_landmarks, next.moved_landmarks, part.moved_landmarks, room,
         [](const auto&) { return kMostIdBytes + kPointBytes; });
    fill(update.removed_landmarks, next.removed_landmarks, part.removed_landmarks, room,
         [](const auto&) { return 2 * kMostIdBytes + 1; });
    parts.push_back(std::move(part));
  } while (next.keyframes < update.keyframes.size() ||
           next.removed_keyframes < update.removed_keyframes.size() ||
           next.landmarks < update.landmarks.size() ||
           next.moved_landmarks < update.moved_landmarks.size() ||
           next.removed_landmarks < update.removed_landmarks.size());
  return parts;
}

void append_part(MapUpdate& whole, MapUpdate part) {
  whole.revision = part.revision;
  whole.mapped_keyframes = part.mapped_keyframes;
  whole.settled = part.settled;
  append(whole.keyframes, part.keyframes);
  append(whole.removed_keyframes, part.removed_keyframes);
  append(whole.parts, part.parts);
  append(whole.landmarks, part.landmarks);
  append(whole.moved_landmarks, part.moved_landmarks);
  append(whole.removed_landmarks, part.removed_landmarks);
}

}  // namespace cairn::wire
