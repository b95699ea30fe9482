#include "server/storage/map_codec.h"

#include <cmath>

namespace cairn::storage {
namespace {

void put(ByteWriter& out, const Eigen::Quaterniond& q) {
  for (int i = 0; i < 4; ++i) out.put(q.coeffs()[i]);
}
Eigen::Quaterniond get_rotation(ByteReader& in) {
  Eigen::Quaterniond q;
  for (int i = 0; i < 4; ++i) q.coeffs()[i] = in.get_double();
  return q;
}

bool is_sound(const Sim3& t) {
  return t.rotation.coeffs().allFinite() && t.translation.allFinite() && std::isfinite(t.scale) &&
         t.scale > 0;
}

}  // namespace

void put(ByteWriter& out, const Eigen::Vector3d& v) {
  for (int i = 0; i < 3; ++i) out.put(v[i]);
}
void put(ByteWriter& out, const Sim3& transform) {
  put(out, transform.rotation);
  put(out, transform.translation);
  out.put(transform.scale);
}
void put(ByteWriter& out, KeyframeId id) {
  out.put(id.epoch);
  out.put(id.sequence);
}
void put(ByteWriter& out, LandmarkId id) {
  out.put(id.origin);
  out.put(id.number);
}
void put(ByteWriter& out, const FormerKeyframe& former) {
  put(out, former.anchor);
  put(out, former.anchor_from_camera);
  out.put(former.since);
}
void put(ByteWriter& out, const FormerLandmark& former) {
  put(out, former.now);
  out.put(former.since);
}
void put(ByteWriter& out, const KeyframeNode& node) {
  put(out, node.scaled_pose());
  put(out, node.parent);
  out.put(node.arrival);
  out.put(node.revision);
}
void put(ByteWriter& out, const Landmark& landmark) {
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
}
void put(ByteWriter& out, const LoopEdge& edge) {
  put(out, edge.query);
  put(out, edge.candidate);
  put(out, edge.candidate_from_query);
  out.put_varint(static_cast<std::uint64_t>(edge.inliers));
  out.put(static_cast<std::uint8_t>(edge.merges));
  put(out, edge.new_map_from_old_map);
  out.put_varint(edge.moved.size());
  for (const std::uint64_t epoch : edge.moved) out.put(epoch);
}

Eigen::Vector3d get_vector(ByteReader& in) {
  Eigen::Vector3d v;
  for (int i = 0; i < 3; ++i) v[i] = in.get_double();
  return v;
}
Sim3 get_transform(ByteReader& in) {
  Sim3 transform;
  transform.rotation = get_rotation(in);
  transform.translation = get_vector(in);
  transform.scale = in.get_double();
  return transform;
}
KeyframeId get_keyframe(ByteReader& in) {
  const auto epoch = in.get<std::uint64_t>();
  return {epoch, in.get<std::uint32_t>()};
}
LandmarkId get_landmark(ByteReader& in) {
  const auto origin = in.get<std::uint64_t>();
  return {origin, in.get<std::uint64_t>()};
}

bool get(ByteReader& in, FormerKeyframe& former) {
  former.anchor = get_keyframe(in);
  former.anchor_from_camera = get_transform(in);
  former.since = in.get<std::uint64_t>();
  return in.ok() && is_sound(former.anchor_from_camera);
}
bool get(ByteReader& in, FormerLandmark& former) {
  former.now = get_landmark(in);
  former.since = in.get<std::uint64_t>();
  return in.ok();
}
bool get(ByteReader& in, KeyframeNode& node) {
  const Sim3 pose = get_transform(in);
  node.map_from_camera = pose.pose();
  node.unit = pose.scale;
  node.parent = get_keyframe(in);
  node.arrival = in.get<std::uint64_t>();
  node.revision = in.get<std::uint64_t>();
  return in.ok() && is_sound(pose);
}
bool get(ByteReader& in, Landmark& landmark) {
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
  return in.ok() && landmark.position.allFinite() && landmark.normal.allFinite();
}
bool get(ByteReader& in, LoopEdge& edge) {
  edge.query = get_keyframe(in);
  edge.candidate = get_keyframe(in);
  edge.candidate_from_query = get_transform(in);
  const std::uint64_t inliers = in.get_varint();
  const auto merges = in.get<std::uint8_t>();
  edge.new_map_from_old_map = get_transform(in);
  const std::uint64_t count = in.get_varint();
  if (inliers > INT32_MAX || merges > 1 || !in.fits(count, 8)) return false;
  edge.inliers = static_cast<int>(inliers);
  edge.merges = merges == 1;
  edge.moved.resize(count);
  for (std::uint64_t& epoch : edge.moved) epoch = in.get<std::uint64_t>();
  return in.ok() && edge.query.is_valid() && edge.candidate.is_valid() &&
         is_sound(edge.candidate_from_query) && is_sound(edge.new_map_from_old_map);
}

void put_header(ByteWriter& out, const Map& map) {
  out.put(map.id.value);
  out.put(map.revision);
  out.put(map.merge_epoch);
  out.put(map.keyframes_ever);
  out.put(map.next_landmark);
}
void get_header(ByteReader& in, Map& map) {
  map.id.value = in.get<std::uint64_t>();
  map.revision = in.get<std::uint64_t>();
  map.merge_epoch = in.get<std::uint32_t>();
  map.keyframes_ever = in.get<std::uint64_t>();
  map.next_landmark = in.get<std::uint64_t>();
}

}  // namespace cairn::storage
