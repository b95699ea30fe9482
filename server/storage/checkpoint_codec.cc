#include "server/storage/checkpoint_codec.h"

#include <algorithm>
#include <unordered_map>

#include "server/storage/map_connect.h"

namespace cairn::storage {
namespace {

constexpr std::size_t kChecksumBytes = sizeof(std::uint64_t);

// FNV-1a (Fowler, Noll and Vo; draft-eastlake-fnv), 64 bits.
std::uint64_t checksum(Bytes bytes) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const std::uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001b3ULL;
  return hash;
}

Error damaged() {
  return {ErrorCode::kCorrupt, "what was kept to undo this event is damaged"};
}

// Where a keyframe stands among those of the blob.
using Places = std::unordered_map<KeyframeId, std::uint64_t>;

void put_descriptor(ByteWriter& out, const Map& map, const Landmark& landmark) {
  std::uint64_t place = 0;
  for (const Observation& seen : landmark.observations) {
    ++place;
    if (map.keyframes.at(seen.keyframe).features().descriptors[seen.feature] ==
        landmark.descriptor) {
      out.put_varint(place);
      return;
    }
  }
  out.put_varint(0);
  for (const std::uint64_t word : landmark.descriptor) out.put(word);
}
bool get_descriptor(ByteReader& in, const Map& map, Landmark& landmark) {
  const std::uint64_t place = in.get_varint();
  if (place > landmark.observations.size()) return false;
  if (place == 0) {
    for (std::uint64_t& word : landmark.descriptor) word = in.get<std::uint64_t>();
    return in.ok();
  }
  const Observation& seen = landmark.observations[place - 1];
  const auto& descriptors = map.keyframes.at(seen.keyframe).features().descriptors;
  if (seen.feature >= descriptors.size()) return false;
  landmark.descriptor = descriptors[seen.feature];
  return true;
}

void put_compact(ByteWriter& out, const Map& map, const Places& places, const Landmark& l) {
  put(out, l.position);
  put(out, l.normal);
  out.put(l.min_distance);
  out.put(l.max_distance);
  for (const std::uint64_t number :
       {std::uint64_t{l.visible}, std::uint64_t{l.found}, l.birth, l.arrival, l.revision})
    out.put_varint(number);
  out.put_varint(l.observations.size());
  for (const Observation& seen : l.observations) {
    out.put_varint(places.at(seen.keyframe));
    out.put(seen.feature);
  }
  out.put_varint(places.at(l.reference));
  put_descriptor(out, map, l);
}

bool get_compact(ByteReader& in, const Map& map, const std::vector<KeyframeId>& keyframes,
                 Landmark& l) {
  l.position = get_vector(in);
  l.normal = get_vector(in);
  l.min_distance = in.get_float();
  l.max_distance = in.get_float();
  l.visible = static_cast<std::uint32_t>(in.get_varint());
  l.found = static_cast<std::uint32_t>(in.get_varint());
  l.birth = in.get_varint();
  l.arrival = in.get_varint();
  l.revision = in.get_varint();
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 3)) return false;
  l.observations.reserve(count);
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t place = in.get_varint();
    if (place >= keyframes.size()) return false;
    l.observations.push_back({keyframes[place], in.get<std::uint16_t>()});
  }
  const std::uint64_t reference = in.get_varint();
  if (reference >= keyframes.size()) return false;
  l.reference = keyframes[reference];
  return get_descriptor(in, map, l) && in.ok() && l.position.allFinite() && l.normal.allFinite();
}

// Names go up; of landmarks with the same origin only the difference is written.
void put_landmarks(ByteWriter& out, const Map& map, const Places& places) {
  LandmarkId last;
  out.put_varint(map.landmarks.size());
  for (const LandmarkId id : map.landmarks.sorted_keys()) {
    const bool same_origin = id.origin == last.origin;
    out.put_varint(same_origin ? id.number - last.number : 0);
    if (!same_origin) put(out, id);
    last = id;
    put_compact(out, map, places, map.landmarks.at(id));
  }
}
bool get_landmarks(ByteReader& in, const std::vector<KeyframeId>& keyframes, Map& map) {
  LandmarkId id;
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 60)) return false;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t step = in.get_varint();
    id = step == 0 ? get_landmark(in) : LandmarkId{id.origin, id.number + step};
    Landmark landmark;
    landmark.id = id;
    if (!id.is_valid() || !get_compact(in, map, keyframes, landmark)) return false;
    map.landmarks.insert(id, std::move(landmark));
  }
  return true;
}

template <typename Key, typename Value>
void put_table(ByteWriter& out, const CowTable<Key, Value>& table) {
  out.put_varint(table.size());
  table.for_each([&](const Key& key, const Value& value) {
    put(out, key);
    put(out, value);
  });
}
template <typename Key, typename Value, typename GetKey>
bool get_table(ByteReader& in, CowTable<Key, Value>& table, GetKey&& get_key) {
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, sizeof(std::uint64_t))) return false;
  for (std::uint64_t i = 0; i < count; ++i) {
    const Key key = get_key(in);
    Value value;
    if (!get(in, value)) return false;
    table.insert(key, std::move(value));
  }
  return true;
}

void put_loops(ByteWriter& out, const Map& map) {
  out.put_varint(map.loops.size());
  for (const LoopEdge& edge : map.loops) put(out, edge);
}
bool get_loops(ByteReader& in, Map& map) {
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, sizeof(LoopEdge) / 2)) return false;
  map.loops.resize(count);
  return std::all_of(map.loops.begin(), map.loops.end(),
                     [&](LoopEdge& edge) { return get(in, edge); });
}

void put_mapped(ByteWriter& out, const Map& map) {
  out.put_varint(map.mapped_keyframes.size());
  map.mapped_keyframes.for_each([&](std::uint64_t epoch, std::uint32_t count) {
    out.put(epoch);
    out.put(count);
  });
}
bool get_mapped(ByteReader& in, Map& map) {
  const std::uint64_t runs = in.get_varint();
  if (!in.fits(runs, 12)) return false;
  for (std::uint64_t i = 0; i < runs; ++i) {
    const auto epoch = in.get<std::uint64_t>();
    map.mapped_keyframes.insert(epoch, in.get<std::uint32_t>());
  }
  return true;
}

// The keyframes with their measurements, which all else refers to.
Status load_measurements(Map& map, const LoadKeyframe& load) {
  for (const KeyframeId id : map.keyframes.sorted_keys()) {
    auto keyframe = load(id);
    if (!keyframe) return keyframe.error();
    map.keyframes.edit(id)->keyframe = std::move(*keyframe);
  }
  return {};
}

}  // namespace

void append_checksum(Blob& bytes) {
  const std::uint64_t sum = checksum(bytes);
  for (std::size_t i = 0; i < kChecksumBytes; ++i)
    bytes.push_back(static_cast<std::uint8_t>(sum >> (8 * i)));
}

Blob encode_checkpoint(const Map& map) {
  ByteWriter out(128 * (map.landmarks.size() + map.keyframes.size()));
  put_header(out, map);
  put_table(out, map.keyframes);
  Places places;
  for (const KeyframeId id : map.keyframes.sorted_keys()) places.emplace(id, places.size());
  put_landmarks(out, map, places);
  put_table(out, map.replaced_landmarks);
  put_table(out, map.removed_keyframes);
  put_loops(out, map);
  put_mapped(out, map);
  Blob bytes = out.take();
  append_checksum(bytes);
  return bytes;
}

Result<Map> decode_checkpoint(Bytes bytes, const LoadKeyframe& load) {
  if (bytes.size() < kChecksumBytes) return damaged();
  ByteReader end(bytes.last(kChecksumBytes));
  const Bytes content = bytes.first(bytes.size() - kChecksumBytes);
  if (checksum(content) != end.get<std::uint64_t>()) return damaged();

  ByteReader in(content);
  Map map;
  get_header(in, map);
  if (!get_table(in, map.keyframes, get_keyframe)) return damaged();
  if (Status status = load_measurements(map, load); !status) return status.error();
  if (!get_landmarks(in, map.keyframes.sorted_keys(), map) ||
      !get_table(in, map.replaced_landmarks, get_landmark) ||
      !get_table(in, map.removed_keyframes, get_keyframe) || !get_loops(in, map) ||
      !get_mapped(in, map) || !in.at_end())
    return damaged();
  if (Status status = connect(map); !status) return status.error();
  return map;
}

}  // namespace cairn::storage
