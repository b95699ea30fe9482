#include <cmath>
#include <string>
#include <unordered_set>

#include "common/model/measurement_noise.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

constexpr int kMinSide = 16, kMaxSide = 16384;            // pixels
constexpr double kMaxBaseline = 100, kMaxDepth = 10'000;  // metres
constexpr float kMaxScaleFactor = 4;
constexpr int kMaxLevels = 16;
// Nanoseconds; leaves room for differences of two stamps.
constexpr std::int64_t kMaxStamp = std::int64_t{1} << 61;

Status unsound(const std::string& what) {
  return {ErrorCode::kInvalidArgument, "keyframe: " + what};
}

bool within(double value, double low, double high) {
  return value >= low && value <= high;
}

Status check_rig(const Rig& rig) {
  const PinholeCamera& c = rig.camera;
  if (rig.sensor > Sensor::kMono) return unsound("unknown sensor");
  if (!within(c.width, kMinSide, kMaxSide) || !within(c.height, kMinSide, kMaxSide))
    return unsound("image size out of range");
  if (!within(c.fx, 0.01 * c.width, 100.0 * c.width) ||
      !within(c.fy, 0.01 * c.height, 100.0 * c.height))
    return unsound("focal length out of range");
  if (!within(c.cx, -c.width, 2 * c.width) || !within(c.cy, -c.height, 2 * c.height))
    return unsound("principal point out of range");
  if (!within(c.baseline, 0, kMaxBaseline)) return unsound("baseline out of range");
  if (rig.sensor != Sensor::kMono && c.baseline == 0) return unsound("sensor without baseline");
  if (!within(rig.max_depth, 0, kMaxDepth)) return unsound("greatest depth out of range");
  if (!(rig.pyramid.factor > 1 && rig.pyramid.factor <= kMaxScaleFactor) ||
      !within(rig.pyramid.levels, 1, kMaxLevels))
    return unsound("pyramid out of range");
  return {};
}

Status check_features(const Features& features, int levels) {
  if (features.size() > kMaxFeatures) return unsound("too many features");
  if (features.descriptors.size() != features.size())
    return unsound("numbers of features and descriptors differ");
  for (const Feature& f : features.points)
    if (f.octave >= levels) return unsound("feature on a level that the pyramid does not have");
  return {};
}

Status check_matches(const Keyframe& keyframe) {
  std::unordered_set<LandmarkId> seen;
  int previous = -1;
  for (const LandmarkMatch& m : keyframe.matches) {
    if (m.feature <= previous) return unsound("matches do not ascend by feature");
    previous = m.feature;
    if (m.feature >= keyframe.features.size())
      return unsound("match of a feature that is not there");
    if (!is_sound(m.landmark)) return unsound("match of an impossible landmark");
    if (!seen.insert(m.landmark).second) return unsound("two features match one landmark");
    const KeyframeId creator = m.landmark.creator();
    if (creator == keyframe.id && m.landmark.creator_feature() != m.feature)
      return unsound("feature matches the landmark made from another one of the same keyframe");
    if (creator.epoch == keyframe.id.epoch && creator.sequence > keyframe.id.sequence)
      return unsound("match of a landmark made later");
  }
  return {};
}

}  // namespace

Status check_client_name(std::string_view name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-' || c == '.';
  };
  bool good = !name.empty() && name.size() <= kMaxClientName && name.front() != '.';
  for (const char c : name) good = good && allowed(c);
  if (good) return {};
  return {ErrorCode::kInvalidArgument,
          "client name: use 1 to 64 letters, digits, '_', '-' or '.', not starting with '.'"};
}

Status check_keyframe(const Keyframe& keyframe) {
  if (!keyframe.id.is_valid()) return unsound("epoch is zero");
  if (keyframe.stamp_ns < -kMaxStamp || keyframe.stamp_ns > kMaxStamp)
    return unsound("time stamp out of range");
  if (!keyframe.rig) return unsound("without a rig");
  if (Status s = check_rig(*keyframe.rig); !s) return s;
  if (!is_sound(keyframe.odom_from_camera) || !is_sound(keyframe.reference_from_camera))
    return unsound("pose is no similarity");
  if (keyframe.reference.epoch == keyframe.id.epoch &&
      keyframe.reference.sequence >= keyframe.id.sequence)
    return unsound("reference is not an earlier keyframe");
  if (!(keyframe.noise >= kMinNoise && keyframe.noise <= kMaxNoise))
    return unsound("noise out of range");
  if (Status s = check_features(keyframe.features, keyframe.rig->pyramid.levels); !s) return s;
  return check_matches(keyframe);
}

}  // namespace cairn::wire
