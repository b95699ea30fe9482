#include "tests/support/sensor_noise.h"

#include <algorithm>
#include <cmath>

#include "tests/support/parallel.h"
#include "tests/support/random.h"

namespace cairn::synthetic {
namespace {

constexpr int kTile = 1024;

std::uint8_t to_byte(float level) {
  return static_cast<std::uint8_t>(std::min(std::max(level + 0.5f, 0.0f), 255.0f));
}

// White noise smoothed with [1 2 1] / 4 both ways, scaled back to standard deviation 1.
std::vector<float> correlated_tile(std::uint64_t seed) {
  Random random(seed);
  std::vector<float> white(kTile * kTile), smooth(kTile * kTile);
  for (float& value : white) {
    // A sum of four uniforms is close enough to normal, and quick.
    const std::uint64_t bits = random.bits();
    int sum = 0;
    for (int part = 0; part < 4; ++part) sum += static_cast<int>((bits >> (16 * part)) & 0xffff);
    value = (static_cast<float>(sum) - 131070.0f) * (1.0f / 37837.0f);
  }
  const auto wrap = [](int i) { return i & (kTile - 1); };
  for (int y = 0; y < kTile; ++y) {
    for (int x = 0; x < kTile; ++x) {
      const float* row = &white[y * kTile];
      smooth[y * kTile + x] = row[wrap(x - 1)] + 2 * row[x] + row[wrap(x + 1)];
    }
  }
  std::vector<float> tile(2 * kTile * kTile);
  for (int y = 0; y < kTile; ++y) {
    for (int x = 0; x < kTile; ++x) {
      const float sum = smooth[wrap(y - 1) * kTile + x] + 2 * smooth[y * kTile + x] +
                        smooth[wrap(y + 1) * kTile + x];
      tile[2 * y * kTile + x] = tile[(2 * y + 1) * kTile + x] = sum / 6.0f;  // (1 + 4 + 1) = 6
    }
  }
  return tile;
}

}  // namespace

SensorNoise::SensorNoise(std::uint64_t seed, const GrayNoise& gray, const DepthNoise& depth)
    : seed_(seed), gray_(gray), depth_(depth), tile_(correlated_tile(derive_seed(seed, 0x701))) {}

const float* SensorNoise::noise_row(int row, std::uint64_t key) const {
  const std::uint64_t offset = derive_seed(seed_, key);
  const int x = static_cast<int>(offset % kTile);
  const int y = static_cast<int>((offset / kTile + static_cast<std::uint64_t>(row)) % kTile);
  return &tile_[2 * y * kTile + x];
}

cv::Mat SensorNoise::gray(const cv::Mat& radiance, std::uint64_t key, int threads) const {
  cv::Mat result(radiance.size(), CV_8UC1);
  const float dark = static_cast<float>(gray_.dark);
  const float slope = static_cast<float>((gray_.bright - gray_.dark) / 255.0);
  parallel_for(radiance.rows, threads, 16, [&](int y) {
    const float* in = radiance.ptr<float>(y);
    auto* out = result.ptr<std::uint8_t>(y);
    // Wider images than the tile repeat their noise; nothing here looks that far.
    for (int begin = 0; begin < radiance.cols; begin += kTile) {
      const float* noise = noise_row(y, key + static_cast<std::uint64_t>(begin));
      const int end = std::min(begin + kTile, radiance.cols);
      for (int x = begin; x < end; ++x) {
        out[x] = to_byte(in[x] + (dark + slope * in[x]) * noise[x - begin]);
      }
    }
  });
  return result;
}

void SensorNoise::depth_row(const cv::Mat& exact, double fx, int row, const float* noise,
                            float* out) const {
  const int width = exact.cols;
  const float* z = exact.ptr<float>(row);
  const float* above = exact.ptr<float>(std::max(0, row - 1));
  const float* below = exact.ptr<float>(std::min(exact.rows - 1, row + 1));
  const float focal_baseline = static_cast<float>(fx * depth_.projector_baseline);
  const float step = static_cast<float>(depth_.disparity_step);
  const float slant = static_cast<float>(depth_.max_slant / fx);
  const float base = static_cast<float>(depth_.base), slope = static_cast<float>(depth_.slope);
  const float offset = static_cast<float>(depth_.offset);
  // Seen from the projector, nearer things move left by their disparity and cover what then lies to
  // the right of their left border: a pixel whose ray comes out right of one already seen, going
  // from right to left, lies in the shadow.
  float leftmost = 1e9f;
  for (int x = width - 1; x >= 0; --x) {
    out[x] = 0;
    const float depth = z[x];
    if (depth <= 0) continue;
    const float from_projector = static_cast<float>(x) - focal_baseline / depth;
    const bool shadow = from_projector > leftmost + 0.75f;
    leftmost = std::min(leftmost, from_projector);
    const float left = z[std::max(0, x - 1)], right = z[std::min(width - 1, x + 1)];
    const float change = std::max(std::max(std::abs(left - depth), std::abs(right - depth)),
                                  std::max(std::abs(above[x] - depth), std::abs(below[x] - depth)));
    // Both a border and a flat angle show as a change of depth from pixel to pixel. Near the limit
    // chance decides.
    const bool torn = change > slant * depth * (1.0f + 0.25f * noise[x]);
    if (shadow || torn) continue;
    const float spread = base + slope * (depth - offset) * (depth - offset);
    const float measured = depth + spread * noise[x];
    if (measured < depth_.min_range || measured > depth_.max_range) continue;
    const float disparity = std::round(focal_baseline / measured / step) * step;
    out[x] = disparity > 0 ? focal_baseline / disparity : 0.0f;
  }
}

cv::Mat SensorNoise::depth(const cv::Mat& exact, double fx, std::uint64_t key, int threads) const {
  cv::Mat result(exact.size(), CV_32FC1);
  parallel_for(exact.rows, threads, 16, [&](int y) {
    // Images wider than the tile would read past a row: they share its noise from the start.
    std::vector<float> noise(static_cast<std::size_t>(exact.cols));
    const float* source = noise_row(y, key ^ 0xdeb7ULL);
    for (int x = 0; x < exact.cols; ++x) noise[x] = source[x % kTile];
    depth_row(exact, fx, y, noise.data(), result.ptr<float>(y));
  });
  return result;
}

cv::Mat quantised(const cv::Mat& radiance) {
  cv::Mat result(radiance.size(), CV_8UC1);
  for (int y = 0; y < radiance.rows; ++y) {
    const float* in = radiance.ptr<float>(y);
    auto* out = result.ptr<std::uint8_t>(y);
    for (int x = 0; x < radiance.cols; ++x) out[x] = to_byte(in[x]);
  }
  return result;
}

}  // namespace cairn::synthetic
