#include "client/frontend/orient.h"

#include <array>
#include <cmath>
#include <cstdint>

namespace cairn {
namespace {

constexpr int kRadius = 15;
constexpr int kWidth = 32;  // columns -16 .. 15: whole vectors; the first one is always masked out
constexpr int kLeft = 16;

// For each distance of a row from the centre, which columns lie in the circle: all ones or none.
using RowMask = std::array<std::int16_t, kWidth>;
constexpr std::array<RowMask, kRadius + 1> circle_masks() {
  std::array<RowMask, kRadius + 1> masks{};
  for (int v = 0; v <= kRadius; ++v)
    for (int i = 0; i < kWidth; ++i) {
      const int u = i - kLeft;
      // Radius 15.5: pixels whose centre is nearer than the middle between 15 and 16.
      const bool inside = 4 * (u * u + v * v) <= 31 * 31 && u >= -kRadius;
      masks[static_cast<std::size_t>(v)][static_cast<std::size_t>(i)] = inside ? -1 : 0;
    }
  return masks;
}
constexpr auto kMasks = circle_masks();

}  // namespace

// Rows v and -v are taken together, and sums kept per column in 16 bits, which suffice:
// 31 rows * 255 and 2 * (1 + ... + 15) / 2 * 255 are below 2^15. The compiler vectorises the loops.
float orientation(const cv::Mat& image, int x, int y) {
  alignas(64) std::int16_t sums[kWidth];          // sum over rows of I
  alignas(64) std::int16_t moments[kWidth] = {};  // sum over rows of v * I
  const std::uint8_t* centre = image.ptr<std::uint8_t>(y) + x - kLeft;
  for (std::size_t i = 0; i < kWidth; ++i)
    sums[i] = static_cast<std::int16_t>(centre[i] & kMasks[0][i]);
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(image.step);
  for (int v = 1; v <= kRadius; ++v) {
    const std::uint8_t* above = centre - v * stride;
    const std::uint8_t* below = centre + v * stride;
    const RowMask& mask = kMasks[static_cast<std::size_t>(v)];
    const auto weight = static_cast<std::int16_t>(v);
    for (std::size_t i = 0; i < kWidth; ++i) {
      const auto a = static_cast<std::int16_t>(above[i]), b = static_cast<std::int16_t>(below[i]);
      const auto difference = static_cast<std::int16_t>((b - a) & mask[i]);
      sums[i] = static_cast<std::int16_t>(sums[i] + ((a + b) & mask[i]));
      moments[i] = static_cast<std::int16_t>(moments[i] + weight * difference);
    }
  }
  int m10 = 0, m01 = 0;
  for (int i = 0; i < kWidth; ++i) {
    m10 += (i - kLeft) * sums[i];
    m01 += moments[i];
  }
  const float angle = std::atan2(static_cast<float>(m01), static_cast<float>(m10));
  constexpr auto kTurn = static_cast<float>(2 * M_PI);
  const float positive = angle < 0 ? angle + kTurn : angle;
  return positive < kTurn ? positive : 0.0f;
}

}  // namespace cairn
