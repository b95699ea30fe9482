#include "common/wire/features_codec.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/wire/descriptor_packing.h"

namespace cairn::wire {
namespace {

constexpr double kDisparityStep = 1.0 / 128;
constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::size_t kPlainBytes = 2 + 2 + 2 + 1;  // but for octave and descriptor

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

std::uint16_t disparity_bits(float disparity) {
  const double q = std::round(disparity / kDisparityStep);
  return q >= 1 && q <= 65535 ? static_cast<std::uint16_t>(q) : 0;
}

std::uint8_t angle_bits(float angle) {
  if (!std::isfinite(angle)) return 0;
  const double turns = angle / kTurn;
  return static_cast<std::uint8_t>(static_cast<int>(std::round((turns - std::floor(turns)) * 256)));
}

}  // namespace

bool is_tellable(const Feature& feature, const PinholeCamera& camera) {
  return Axis(camera.width).covers(feature.x) && Axis(camera.height).covers(feature.y);
}

void put_features(ByteWriter& out, const Features& features, const PinholeCamera& camera) {
  const Axis x_axis(camera.width), y_axis(camera.height);
  out.put(static_cast<std::uint16_t>(features.size()));
  for (const Feature& f : features.points) {
    out.put(x_axis.to_bits(std::isfinite(f.x) ? f.x : 0.f));
    out.put(y_axis.to_bits(std::isfinite(f.y) ? f.y : 0.f));
    out.put(is_tellable(f, camera) ? disparity_bits(f.disparity) : std::uint16_t{0});
    out.put(angle_bits(f.angle));
  }
  // Two to a byte.
  for (std::size_t i = 0; i < features.size(); i += 2) {
    const unsigned next = i + 1 < features.size() ? features.points[i + 1].octave : 0;
    out.put(static_cast<std::uint8_t>(features.points[i].octave | next << 4));
  }
  const Blob packed = pack_descriptors(features.descriptors);
  out.put(static_cast<std::uint32_t>(packed.size()));
  out.put_bytes(packed);
}

bool get_features(ByteReader& in, const PinholeCamera& camera, Features& features) {
  const Axis x_axis(camera.width), y_axis(camera.height);
  const auto count = in.get<std::uint16_t>();
  if (count > kMaxFeatures || !in.fits(count, kPlainBytes)) return false;
  features.points.resize(count);
  features.descriptors.resize(count);
  for (Feature& f : features.points) {
    f.x = x_axis.from_bits(in.get<std::uint16_t>());
    f.y = y_axis.from_bits(in.get<std::uint16_t>());
    f.disparity = static_cast<float>(in.get<std::uint16_t>() * kDisparityStep);
    f.angle = static_cast<float>(in.get<std::uint8_t>() * (kTurn / 256));
  }
  for (std::size_t i = 0; i < count; i += 2) {
    const auto octaves = in.get<std::uint8_t>();
    features.points[i].octave = octaves & 0xf;
    if (i + 1 < count)
      features.points[i + 1].octave = octaves >> 4;
    else if (octaves >> 4 != 0)
      return false;
  }
  const auto packed = in.get<std::uint32_t>();
  const Bytes descriptors = in.get_bytes(packed);
  return in.ok() && unpack_descriptors(descriptors, features.descriptors);
}

}  // namespace cairn::wire
