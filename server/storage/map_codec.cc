#include "server/storage/map_codec.h"

#include <algorithm>
#include <unordered_map>

#include "common/wire/bytes.h"

namespace cairn::storage {
namespace {

using wire::ByteReader;
using wire::ByteWriter;

void put(ByteWriter& out, const Eigen::Vector3d& v) {
  for (int i = 0; i < 3; ++i) out.put(v[i]);
}
void put(ByteWriter& out, const Rigid3& pose) {
  for (int i = 0; i < 4; ++i) out.put(pose.rotation.coeffs()[i]);
  put(out, pose.translation);
}
void put(ByteWriter& out, KeyframeId id) {
  out.put(id.epoch);
  out.put(id.sequence);
}

Eigen::Vector3d get_vector(ByteReader& in) {
  Eigen::Vector3d v;
  for (int i = 0; i < 3; ++i) v[i] = in.get_double();
  return v;
}
Rigid3 get_pose(ByteReader& in) {
  Rigid3 pose;
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = in.get_double();
  pose.translation = get_vector(in);
  return pose;
}
KeyframeId get_keyframe(ByteReader& in) {
  const auto epoch = in.get<std::uint64_t>();
  return {epoch, in.get<std::uint32_t>()};
}

Error contradiction(const char* what) {
  return {ErrorCode::kCorrupt, std::string("the saved map contradicts itself: ") + what};
}

// Enters the landmarks into the keyframes that see them.
Status connect_landmarks(Map& map) {
  for (const LandmarkId id : map.landmarks.sorted_keys()) {
    const Landmark& landmark = map.landmarks.at(id);
    if (landmark.observations.empty()) return contradiction("a landmark is seen by no keyframe");
    bool reference_sees = false;
    for (const Observation& seen : landmark.observations) {
      KeyframeNode* node = map.keyframes.edit(seen.keyframe);
      if (!node || seen.feature >= node->landmarks.size())
        return contradiction("a landmark is seen by a keyframe that is not there");
      if (node->landmarks[seen.feature].is_valid())
        return contradiction("one feature shows two landmarks");
      node->landmarks[seen.feature] = id;
      reference_sees |= seen.keyframe == landmark.reference;
    }
    if (!reference_sees) return contradiction("a landmark's reference keyframe does not see it");
  }
  return {};
}

void connect_covisible(Map& map, KeyframeNode& node) {
  std::unordered_map<KeyframeId, int> shared;
  for (const LandmarkId& id : node.landmarks) {
    if (!id.is_valid()) continue;
    for (const Observation& seen : map.landmarks.at(id).observations) ++shared[seen.keyframe];
  }
  shared.erase(node.keyframe->id);
  node.covisible.clear();
  for (const auto& [keyframe, count] : shared) node.covisible.push_back({keyframe, count});
  std::sort(node.covisible.begin(), node.covisible.end(),
            [](const Covisible& a, const Covisible& b) {
              return a.shared != b.shared ? a.shared > b.shared : a.keyframe < b.keyframe;
            });
}

Status connect_tree(Map& map, const std::vector<KeyframeId>& keyframes) {
  for (const KeyframeId id : keyframes) {
    const KeyframeId parent = map.keyframes.at(id).parent;
    if (!parent.is_valid()) continue;
    KeyframeNode* node = map.keyframes.edit(parent);
    if (!node) return contradiction("a keyframe's parent is not there");
    node->children.push_back(id);  // ascending, as the loop is
  }
  // What roots lead to is all there is, unless parents make a cycle.
  std::vector<KeyframeId> reached;
  for (const KeyframeId id : keyframes)
    if (!map.keyframes.at(id).parent.is_valid()) reached.push_back(id);
  for (std::size_t i = 0; i < reached.size(); ++i) {
    const auto& children = map.keyframes.at(reached[i]).children;
    reached.insert(reached.end(), children.begin(), children.end());
  }
  if (reached.size() != keyframes.size()) return contradiction("a keyframe descends from itself");
  return {};
}

// Followed by Map::resolve() and Map::pose_of() to their end, which has to be there.
template <typename Key, typename Value, typename Next>
bool chains_end(const CowTable<Key, Value>& table, Next&& next) {
  bool all_end = true;
  table.for_each([&](const Key& key, const Value&) {
    std::size_t steps = 0;
    Key at = key;
    for (const Value* link = table.find(at); link && steps <= table.size(); ++steps) {
      at = next(*link);
      link = table.find(at);
    }
    all_end &= steps <= table.size();
  });
  return all_end;
}

}  // namespace

Blob encode_node(const KeyframeNode& node) {
  ByteWriter out(96);
  put(out, node.map_from_camera);
  put(out, node.parent);
  out.put(node.arrival);
  out.put(node.revision);
  return out.take();
}

bool decode_node(Bytes bytes, KeyframeNode& node) {
  ByteReader in(bytes);
  node.map_from_camera = get_pose(in);
  node.parent = get_keyframe(in);
  node.arrival = in.get<std::uint64_t>();
  node.revision = in.get<std::uint64_t>();
  return in.at_end() && node.map_from_camera.is_finite();
}

Blob encode_landmark(const Landmark& landmark) {
  ByteWriter out(160 + 14 * landmark.observations.size());
  put(out, landmark.position);
  put(out, landmark.reference);
  for (const std::uint64_t word : landmark.descriptor) out.put(word);
  put(out, landmark.normal);
  out.put(landmark.min_distance);
  out.put(landmark.max_distance);
  out.put(landmark.visible);
  out.put(landmark.found);
  out.put(landmark.birth);
  out.put(landmark.arrival);
  out.put(landmark.revision);
  out.put_varint(landmark.observations.size());
  for (const Observation& seen : landmark.observations) {
    put(out, seen.keyframe);
    out.put(seen.feature);
  }
  return out.take();
}

bool decode_landmark(Bytes bytes, Landmark& landmark) {
  ByteReader in(bytes);
  landmark.position = get_vector(in);
  landmark.reference = get_keyframe(in);
  for (std::uint64_t& word : landmark.descriptor) word = in.get<std::uint64_t>();
  landmark.normal = get_vector(in);
  landmark.min_distance = in.get_float();
  landmark.max_distance = in.get_float();
  landmark.visible = in.get<std::uint32_t>();
  landmark.found = in.get<std::uint32_t>();
  landmark.birth = in.get<std::uint64_t>();
  landmark.arrival = in.get<std::uint64_t>();
  landmark.revision = in.get<std::uint64_t>();
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 14)) return false;
  landmark.observations.resize(count);
  for (Observation& seen : landmark.observations) {
    seen.keyframe = get_keyframe(in);
    seen.feature = in.get<std::uint16_t>();
  }
  return in.at_end() && landmark.position.allFinite() && landmark.normal.allFinite();
}

Blob encode_former(const FormerKeyframe& former) {
  ByteWriter out(96);
  put(out, former.anchor);
  put(out, former.anchor_from_camera);
  out.put(former.since);
  return out.take();
}

bool decode_former(Bytes bytes, FormerKeyframe& former) {
  ByteReader in(bytes);
  former.anchor = get_keyframe(in);
  former.anchor_from_camera = get_pose(in);
  former.since = in.get<std::uint64_t>();
  return in.at_end() && former.anchor_from_camera.is_finite();
}

Blob encode_former(const FormerLandmark& former) {
  ByteWriter out(24);
  out.put(former.now.origin);
  out.put(former.now.number);
  out.put(former.since);
  return out.take();
}

bool decode_former(Bytes bytes, FormerLandmark& former) {
  ByteReader in(bytes);
  former.now.origin = in.get<std::uint64_t>();
  former.now.number = in.get<std::uint64_t>();
  former.since = in.get<std::uint64_t>();
  return in.at_end();
}

Status connect(Map& map) {
  if (!chains_end(map.replaced_landmarks, [](const FormerLandmark& f) { return f.now; }))
    return contradiction("landmarks replace each other in a circle");
  if (!chains_end(map.removed_keyframes, [](const FormerKeyframe& f) { return f.anchor; }))
    return contradiction("culled keyframes hang on each other in a circle");
  const std::vector<KeyframeId> keyframes = map.keyframes.sorted_keys();
  for (const KeyframeId id : keyframes) {
    KeyframeNode& node = *map.keyframes.edit(id);
    node.landmarks.assign(node.features().size(), LandmarkId{});
    node.children.clear();
  }
  if (Status status = connect_landmarks(map); !status) return status;
  for (const KeyframeId id : keyframes) connect_covisible(map, *map.keyframes.edit(id));
  return connect_tree(map, keyframes);
}

}  // namespace cairn::storage
