#include "common/wire/keyframe_codec.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_set>
#include <utility>

#include "common/wire/envelope.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

constexpr std::size_t kFeatureBytes = 2 + 2 + 2 + 1 + 1 + kDescriptorBytes;
constexpr double kDisparityStep = 1.0 / 128;
constexpr double kTurn = 2 * std::numbers::pi;

// Maps one pixel coordinate to 16 bits and back.
struct Axis {
  double low, step;
  explicit Axis(int side) : low(-0.25 * side), step(1.5 * side / 65535.0) {}

  bool covers(float v) const { return v >= low - 0.5 * step && v <= low + 65535.5 * step; }
  std::uint16_t to_bits(float v) const {
    return static_cast<std::uint16_t>(std::clamp(std::round((v - low) / step), 0.0, 65535.0));
  }
  float from_bits(std::uint16_t q) const { return static_cast<float>(low + q * step); }
};

bool in_range(const Feature& f, const PinholeCamera& camera) {
  return Axis(camera.width).covers(f.x) && Axis(camera.height).covers(f.y);
}

std::uint16_t disparity_bits(float disparity) {
  const double q = std::round(disparity / kDisparityStep);
  return q >= 1 && q <= 65535 ? static_cast<std::uint16_t>(q) : 0;
}

std::uint8_t angle_bits(float angle) {
  if (!std::isfinite(angle)) return 0;
  const double turns = angle / kTurn;
  return static_cast<std::uint8_t>(static_cast<int>(std::round((turns - std::floor(turns)) * 256)));
}

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

void put_features(ByteWriter& out, const Features& features, const PinholeCamera& camera) {
  const Axis x_axis(camera.width), y_axis(camera.height);
  out.put(static_cast<std::uint16_t>(features.size()));
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Feature& f = features.points[i];
    out.put(x_axis.to_bits(std::isfinite(f.x) ? f.x : 0.f));
    out.put(y_axis.to_bits(std::isfinite(f.y) ? f.y : 0.f));
    out.put(in_range(f, camera) ? disparity_bits(f.disparity) : std::uint16_t{0});
    out.put(f.octave);
    out.put(angle_bits(f.angle));
    put_descriptor(out, features.descriptors[i]);
  }
}

Features get_features(ByteReader& in, const PinholeCamera& camera) {
  const Axis x_axis(camera.width), y_axis(camera.height);
  const auto count = in.get<std::uint16_t>();
  Features features;
  if (!in.fits(count, kFeatureBytes)) return features;
  features.points.resize(count);
  features.descriptors.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    Feature& f = features.points[i];
    f.x = x_axis.from_bits(in.get<std::uint16_t>());
    f.y = y_axis.from_bits(in.get<std::uint16_t>());
    f.disparity = static_cast<float>(in.get<std::uint16_t>() * kDisparityStep);
    f.octave = in.get<std::uint8_t>();
    f.angle = static_cast<float>(in.get<std::uint8_t>() * (kTurn / 256));
    features.descriptors[i] = get_descriptor(in);
  }
  return features;
}

// Features are named by their distance from the one before.
void put_matches(ByteWriter& out, const std::vector<LandmarkMatch>& matches) {
  EpochTableWriter epochs;
  for (const LandmarkMatch& m : matches) epochs.add(m.landmark.origin);
  epochs.put_table(out);
  out.put_varint(matches.size());
  std::uint32_t next = 0;
  for (const LandmarkMatch& m : matches) {
    out.put_varint(m.feature - next);
    epochs.put(out, m.landmark);
    next = m.feature + 1u;
  }
}

bool get_matches(ByteReader& in, std::vector<LandmarkMatch>& matches) {
  EpochTableReader epochs;
  if (!epochs.read(in)) return false;
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 3)) return false;
  matches.reserve(count);
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

// What is left of the matches when features out of range have lost theirs and each landmark has
// kept its first.
std::vector<LandmarkMatch> sendable_matches(const Keyframe& keyframe) {
  const Features& features = keyframe.features;
  std::unordered_set<LandmarkId> seen;
  std::vector<LandmarkMatch> kept;
  kept.reserve(keyframe.matches.size());
  for (const LandmarkMatch& m : keyframe.matches) {
    const bool lost =
        m.feature < features.size() && !in_range(features.points[m.feature], keyframe.rig->camera);
    if (!lost && seen.insert(m.landmark).second) kept.push_back(m);
  }
  return kept;
}

// Poses come out of long products; leave them alone unless they have drifted, so that encoding what
// was decoded changes nothing.
void settle(Rigid3& transform) {
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

  ByteWriter out(300 + head.features.size() * kFeatureBytes + head.matches.size() * 12);
  out.put_string(client);
  out.put(head.id.epoch);
  out.put(head.id.sequence);
  out.put(static_cast<std::uint64_t>(head.stamp_ns));
  put_rig(out, *head.rig);
  put_rigid(out, head.odom_from_camera);
  out.put(head.reference.epoch);
  if (head.reference.is_valid()) {
    out.put(head.reference.sequence);
    put_rigid(out, head.reference_from_camera);
  }
  out.put(head.noise);
  put_features(out, head.features, head.rig->camera);
  put_matches(out, head.matches);
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
  keyframe->odom_from_camera = get_rigid(in);
  keyframe->reference.epoch = in.get<std::uint64_t>();
  if (keyframe->reference.is_valid()) {
    keyframe->reference.sequence = in.get<std::uint32_t>();
    keyframe->reference_from_camera = get_rigid(in);
  }
  keyframe->noise = in.get_float();
  keyframe->features = get_features(in, keyframe->rig->camera);
  if (!in.ok() || !get_matches(in, keyframe->matches) || !in.at_end()) return malformed;
  if (Status s = check_keyframe(*keyframe); !s) return Error{ErrorCode::kCorrupt, s.message()};
  decoded.keyframe = std::move(keyframe);
  return decoded;
}

}  // namespace cairn::wire
