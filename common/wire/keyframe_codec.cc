#include "common/wire/keyframe_codec.h"

#include <algorithm>
#include <cmath>
#include <unordered_set>
#include <utility>

#include "common/wire/envelope.h"
#include "common/wire/features_codec.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

void put_rig(ByteWriter& out, const Rig& rig) {
  const PinholeCamera& c = rig.camera;
  out.put(static_cast<std::uint8_t>(rig.sensor));
  out.put(static_cast<std::uint16_t>(c.width));
  out.put(static_cast<std::uint16_t>(c.height));
  for (const double v : {c.fx, c.fy, c.cx, c.cy, c.baseline, rig.max_depth}) out.put(v);
  out.put(rig.pyramid.factor);
  out.put(rig.pyramid.levels);
}

std::shared_ptr<const Rig> get_rig(ByteReader& in) {
  auto rig = std::make_shared<Rig>();
  PinholeCamera& c = rig->camera;
  rig->sensor = static_cast<Sensor>(in.get<std::uint8_t>());
  c.width = in.get<std::uint16_t>();
  c.height = in.get<std::uint16_t>();
  for (double* v : {&c.fx, &c.fy, &c.cx, &c.cy, &c.baseline, &rig->max_depth}) *v = in.get_double();
  rig->pyramid.factor = in.get_float();
  rig->pyramid.levels = in.get<std::uint8_t>();
  return rig;
}

// Whether the match makes a landmark of its own feature.
bool makes_landmark(const LandmarkMatch& match, KeyframeId keyframe) {
  return match.landmark == LandmarkId::from_feature(keyframe, match.feature);
}

// A bit for each feature that makes a landmark; then the others, each feature by its distance from
// the one before.
void put_matches(ByteWriter& out, const Keyframe& keyframe) {
  Blob makers((keyframe.features.size() + 7) / 8);
  EpochTableWriter epochs;
  std::size_t others = 0;
  for (const LandmarkMatch& m : keyframe.matches) {
    if (makes_landmark(m, keyframe.id)) {
      makers[m.feature / 8] |= static_cast<std::uint8_t>(1u << (m.feature % 8));
    } else {
      epochs.add(m.landmark.origin);
      ++others;
    }
  }
  out.put_bytes(makers);
  epochs.put_table(out);
  out.put_varint(others);
  std::uint32_t next = 0;
  for (const LandmarkMatch& m : keyframe.matches) {
    if (makes_landmark(m, keyframe.id)) continue;
    out.put_varint(m.feature - next);
    epochs.put(out, m.landmark);
    next = m.feature + 1u;
  }
}

bool get_other_matches(ByteReader& in, std::vector<LandmarkMatch>& matches) {
  EpochTableReader epochs;
  if (!epochs.read(in)) return false;
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 3)) return false;
  std::uint64_t next = 0;
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint64_t distance = in.get_varint();
    if (distance > kMaxFeatures || next + distance > kMaxFeatures) return false;
    const std::uint64_t feature = next + distance;
    matches.push_back({static_cast<std::uint16_t>(feature), epochs.get_landmark(in)});
    next = feature + 1;
  }
  return in.ok();
}

bool get_matches(ByteReader& in, Keyframe& keyframe) {
  const std::size_t features = keyframe.features.size();
  const Bytes makers = in.get_bytes((features + 7) / 8);
  if (!in.ok()) return false;
  for (std::size_t f = 0; f < 8 * makers.size(); ++f) {
    if ((makers[f / 8] >> (f % 8) & 1) == 0) continue;
    if (f >= features) return false;
    const auto feature = static_cast<std::uint16_t>(f);
    keyframe.matches.push_back({feature, LandmarkId::from_feature(keyframe.id, feature)});
  }
  const auto made = static_cast<std::ptrdiff_t>(keyframe.matches.size());
  if (!get_other_matches(in, keyframe.matches)) return false;
  // A feature that stands in both is found by the check.
  std::inplace_merge(keyframe.matches.begin(), keyframe.matches.begin() + made,
                     keyframe.matches.end(),
                     [](const auto& a, const auto& b) { return a.feature < b.feature; });
  return true;
}

// What is left of the matches when features out of range have lost theirs and each landmark has
// kept its first.
std::vector<LandmarkMatch> sendable_matches(const Keyframe& keyframe) {
  const Features& features = keyframe.features;
  std::unordered_set<LandmarkId> seen;
  std::vector<LandmarkMatch> kept;
  kept.reserve(keyframe.matches.size());
  for (const LandmarkMatch& m : keyframe.matches) {
    const bool lost = m.feature < features.size() &&
                      !is_tellable(features.points[m.feature], keyframe.rig->camera);
    if (!lost && seen.insert(m.landmark).second) kept.push_back(m);
  }
  return kept;
}

// Poses come out of long products; leave them alone unless they have drifted, so that encoding what
// was decoded changes nothing.
void settle(Sim3& transform) {
  const double error = std::abs(transform.rotation.norm() - 1);
  if (error > 1e-9 && error < 1e-3) transform.rotation.normalize();
}

}  // namespace

Result<Blob> encode_keyframe(std::string_view client, const Keyframe& original) {
  if (Status s = check_client_name(client); !s) return s.error();
  if (!original.rig) return Error{ErrorCode::kInvalidArgument, "keyframe: without a rig"};
  Keyframe head = original;
  settle(head.odom_from_camera);
  settle(head.reference_from_camera);
  head.matches = sendable_matches(original);
  if (Status s = check_keyframe(head); !s) return s.error();

  ByteWriter out(300 + head.features.size() * 40 + head.matches.size() * 12);
  out.put_string(client);
  out.put(head.id.epoch);
  out.put(head.id.sequence);
  out.put(static_cast<std::uint64_t>(head.stamp_ns));
  put_rig(out, *head.rig);
  put_similarity(out, head.odom_from_camera);
  out.put(head.reference.epoch);
  if (head.reference.is_valid()) {
    out.put(head.reference.sequence);
    put_similarity(out, head.reference_from_camera);
  }
  out.put(head.noise);
  put_features(out, head.features, head.rig->camera);
  put_matches(out, head);
  return seal(kKeyframeFormat, out.take());
}

Result<DecodedKeyframe> decode_keyframe(Bytes blob) {
  if (blob.size() > kMaxKeyframeBytes) return Error{ErrorCode::kCorrupt, "keyframe: too large"};
  const Result<Bytes> payload = unseal(kKeyframeFormat, blob);
  if (!payload) return payload.error();
  const Error malformed{ErrorCode::kCorrupt, "keyframe: contents contradict the format"};

  ByteReader in(*payload);
  DecodedKeyframe decoded;
  auto keyframe = std::make_shared<Keyframe>();
  decoded.client.name = in.get_string();
  if (!check_client_name(decoded.client.name)) return malformed;
  decoded.client.epoch = keyframe->id.epoch = in.get<std::uint64_t>();
  keyframe->id.sequence = in.get<std::uint32_t>();
  keyframe->stamp_ns = static_cast<std::int64_t>(in.get<std::uint64_t>());
  keyframe->rig = get_rig(in);
  keyframe->odom_from_camera = get_similarity(in);
  keyframe->reference.epoch = in.get<std::uint64_t>();
  if (keyframe->reference.is_valid()) {
    keyframe->reference.sequence = in.get<std::uint32_t>();
    keyframe->reference_from_camera = get_similarity(in);
  }
  keyframe->noise = in.get_float();
  if (!get_features(in, keyframe->rig->camera, keyframe->features) || !get_matches(in, *keyframe) ||
      !in.at_end())
    return malformed;
  if (Status s = check_keyframe(*keyframe); !s) return Error{ErrorCode::kCorrupt, s.message()};
  decoded.keyframe = std::move(keyframe);
  return decoded;
}

}  // namespace cairn::wire
