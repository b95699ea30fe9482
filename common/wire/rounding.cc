#include "common/wire/rounding.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace cairn::wire {
namespace {

// ---- directions

// A point of the square [-1, 1]^2 that a direction folds out to: the octahedral map (Cigolle et al.
// 2014, "A survey of efficient representations for independent unit vectors", section 3.1).
struct Folded {
  double x = 0, y = 0;
};

Folded across_the_edge(const Folded& f) {
  return {std::copysign(1 - std::abs(f.y), f.x), std::copysign(1 - std::abs(f.x), f.y)};
}

Folded fold(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction / direction.lpNorm<1>();
  const Folded f{d.x(), d.y()};
  return d.z() < 0 ? across_the_edge(f) : f;
}

Eigen::Vector3d unfold(const Folded& f) {
  const double z = 1 - std::abs(f.x) - std::abs(f.y);
  const Folded flat = z < 0 ? across_the_edge(f) : f;
  return Eigen::Vector3d(flat.x, flat.y, z).normalized();
}

// The steps of [-1, 1] are numbered 0 .. last.
std::uint32_t step_of(double v, std::uint32_t last) {
  return static_cast<std::uint32_t>(std::lround(std::clamp((v + 1) / 2, 0.0, 1.0) * last));
}
double from_step(std::uint32_t step, std::uint32_t last) {
  return 2.0 * step / last - 1;
}

constexpr std::uint32_t kFineLast = 65535;
constexpr std::uint32_t kNormalLast = 4094;  // an even number: there is a step for 0
constexpr std::uint32_t kNoNormal = 0xffffff;

// ---- distances

constexpr double kLeast = 1e-3, kMost = 1e4;            // metres
constexpr double kLogStep = 16.11809565095832 / 65535;  // ln(kMost / kLeast) / 65535

std::uint16_t distance_bits(double distance) {
  const double steps = std::log(std::clamp(distance, kLeast, kMost) / kLeast) / kLogStep;
  return static_cast<std::uint16_t>(std::lround(steps));
}
double from_distance_bits(std::uint16_t bits) {
  return kLeast * std::exp(bits * kLogStep);
}

// near / far, in steps of 2^(-1/32); the last one stands for nothing.
constexpr double kRatioSteps = 32;
constexpr std::uint8_t kNoNear = 255;

// ---- rotations

constexpr int kRotationBits = 20;
constexpr std::uint32_t kRotationLast = (1u << kRotationBits) - 2;  // an even number, as above
constexpr double kLargestOfOthers = 0.70710678118654752;  // two components are at most this large

}  // namespace

void put_point(ByteWriter& out, const Eigen::Vector3d& point, const Eigen::Vector3d& centre) {
  const Eigen::Vector3d from_centre = point - centre;
  const double distance = from_centre.norm();
  const Folded f = fold(distance > 0 ? from_centre : Eigen::Vector3d::UnitZ());
  out.put(static_cast<std::uint16_t>(step_of(f.x, kFineLast)));
  out.put(static_cast<std::uint16_t>(step_of(f.y, kFineLast)));
  out.put(distance_bits(distance));
}

Eigen::Vector3d get_point(ByteReader& in, const Eigen::Vector3d& centre) {
  const double x = from_step(in.get<std::uint16_t>(), kFineLast);
  const double y = from_step(in.get<std::uint16_t>(), kFineLast);
  const double distance = from_distance_bits(in.get<std::uint16_t>());
  return centre + distance * unfold({x, y});
}

void put_normal(ByteWriter& out, const Eigen::Vector3d& normal) {
  std::uint32_t bits = kNoNormal;
  if (normal.norm() > 0) {
    const Folded f = fold(normal);
    bits = step_of(f.x, kNormalLast) << 12 | step_of(f.y, kNormalLast);
  }
  for (int shift = 0; shift < 24; shift += 8) out.put(static_cast<std::uint8_t>(bits >> shift));
}

Eigen::Vector3d get_normal(ByteReader& in) {
  std::uint32_t bits = 0;
  for (int shift = 0; shift < 24; shift += 8)
    bits |= static_cast<std::uint32_t>(in.get<std::uint8_t>()) << shift;
  if (bits == kNoNormal) return Eigen::Vector3d::Zero();
  return unfold({from_step(bits >> 12, kNormalLast), from_step(bits & 0xfff, kNormalLast)});
}

void put_range(ByteWriter& out, float near, float far) {
  out.put(distance_bits(far));
  const double steps = near > 0 ? std::round(kRatioSteps * std::log2(far / near)) : kNoNear;
  out.put(static_cast<std::uint8_t>(std::clamp(steps, 0.0, double{kNoNear})));
}

void get_range(ByteReader& in, float& near, float& far) {
  const double distance = from_distance_bits(in.get<std::uint16_t>());
  const auto ratio = in.get<std::uint8_t>();
  far = static_cast<float>(distance);
  near = ratio == kNoNear ? 0 : static_cast<float>(distance * std::exp2(-ratio / kRatioSteps));
}

// The largest component of the quaternion follows from the other three, which then have the same
// sign as with a positive largest one.
void put_pose(ByteWriter& out, const Rigid3& pose, const Eigen::Vector3d& centre) {
  const Eigen::Vector4d q = pose.rotation.coeffs();
  Eigen::Index largest = 0;
  q.cwiseAbs().maxCoeff(&largest);
  std::uint64_t bits = static_cast<std::uint64_t>(largest);
  for (Eigen::Index i = 0; i < 4; ++i) {
    if (i == largest) continue;
    const double v = std::copysign(1.0, q[largest]) * q[i] / kLargestOfOthers;
    bits = bits << kRotationBits | step_of(v, kRotationLast);
  }
  out.put(bits);
  for (Eigen::Index i = 0; i < 3; ++i) out.put(static_cast<float>(pose.translation[i] - centre[i]));
}

Rigid3 get_pose(ByteReader& in, const Eigen::Vector3d& centre) {
  const auto bits = in.get<std::uint64_t>();
  const auto largest = static_cast<Eigen::Index>(bits >> (3 * kRotationBits) & 3);
  constexpr std::uint64_t kMask = (std::uint64_t{1} << kRotationBits) - 1;
  Eigen::Vector4d q;
  int shift = 2 * kRotationBits;
  double rest = 1;
  for (Eigen::Index i = 0; i < 4; ++i) {
    if (i == largest) continue;
    q[i] = kLargestOfOthers *
           from_step(static_cast<std::uint32_t>(bits >> shift & kMask), kRotationLast);
    rest -= q[i] * q[i];
    shift -= kRotationBits;
  }
  // Three components that leave too little for the largest are no rotation: NaN fails the checks.
  q[largest] = rest < 0.2 || bits >> 62 != 0 ? std::nan("") : std::sqrt(rest);
  Eigen::Vector3d translation = centre;
  for (Eigen::Index i = 0; i < 3; ++i) translation[i] += in.get_float();
  Eigen::Quaterniond rotation;
  rotation.coeffs() = q;
  return {rotation, translation};
}

}  // namespace cairn::wire
