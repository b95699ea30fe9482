#include "client/frontend/entropy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace cairn {
namespace {

using Histogram = std::array<std::uint32_t, 256>;

// Four histograms in turn: equal neighbours would otherwise wait for each other's store.
Histogram histogram(const cv::Mat& block) {
  alignas(64) std::uint32_t bins[4][256] = {};
  for (int y = 0; y < block.rows; ++y) {
    const std::uint8_t* row = block.ptr<std::uint8_t>(y);
    int x = 0;
    for (; x + 4 <= block.cols; x += 4) {
      ++bins[0][row[x]];
      ++bins[1][row[x + 1]];
      ++bins[2][row[x + 2]];
      ++bins[3][row[x + 3]];
    }
    for (; x < block.cols; ++x) ++bins[0][row[x]];
  }
  Histogram sum;
  for (std::size_t i = 0; i < 256; ++i) sum[i] = bins[0][i] + bins[1][i] + bins[2][i] + bins[3][i];
  return sum;
}

// n log2 n for the counts that occur in blocks of ordinary size.
constexpr std::size_t kTableSize = 8192;
const std::array<float, kTableSize>& n_log_n_table() {
  static const auto table = [] {
    std::array<float, kTableSize> t{};
    for (std::size_t n = 2; n < kTableSize; ++n)
      t[n] = static_cast<float>(static_cast<double>(n) * std::log2(static_cast<double>(n)));
    return t;
  }();
  return table;
}

// H = -sum c/n log2(c/n) = log2 n - (sum c log2 c) / n, over the histogram's counts c.
double histogram_entropy(const Histogram& h, double pixels) {
  const auto& table = n_log_n_table();
  double sum = 0;
  for (const std::uint32_t count : h)
    sum += count < kTableSize ? static_cast<double>(table[count]) : count * std::log2(count);
  return std::max(0.0, std::log2(pixels) - sum / pixels);
}

// Pixels of grey level g all have the share g / S: H = log2 S - (sum count(g) g log2 g) / S.
double share_entropy(const Histogram& h) {
  const auto& table = n_log_n_table();
  double total = 0, sum = 0;
  for (std::size_t g = 1; g < 256; ++g) {
    total += static_cast<double>(h[g]) * static_cast<double>(g);
    sum += static_cast<double>(h[g]) * static_cast<double>(table[g]);
  }
  return total > 0 ? std::max(0.0, std::log2(total) - sum / total) : 0.0;
}

}  // namespace

double entropy(const cv::Mat& block, EntropyVariant variant) {
  if (block.empty()) return 0;
  const Histogram h = histogram(block);
  return variant == EntropyVariant::kShares
             ? share_entropy(h)
             : histogram_entropy(h, static_cast<double>(block.total()));
}

BlockGrid::BlockGrid(cv::Size image, int block)
    : image_(image),
      columns_(std::max(1, (image.width + block / 2) / block)),
      rows_(std::max(1, (image.height + block / 2) / block)) {}

cv::Rect BlockGrid::area(int index) const {
  const int column = index % columns_, row = index / columns_;
  const int left = column * image_.width / columns_, right = (column + 1) * image_.width / columns_;
  const int top = row * image_.height / rows_, bottom = (row + 1) * image_.height / rows_;
  return {left, top, right - left, bottom - top};
}

void append_block_entropies(const cv::Mat& image, const BlockGrid& grid, EntropyVariant variant,
                            std::vector<float>& entropies) {
  for (int i = 0; i < grid.size(); ++i)
    entropies.push_back(static_cast<float>(entropy(image(grid.area(i)), variant)));
}

double EntropyThreshold::next(double image_mean) {
  ++images_;
  mean_ += (image_mean - mean_) / static_cast<double>(images_);
  switch (options_.mode) {
    case EntropyMode::kOff:
      return 0;
    case EntropyMode::kOnline:
      return mean_ / 2 + options_.delta;
    case EntropyMode::kCalibrated:
      return options_.scene_mean / 2 + options_.delta;
    case EntropyMode::kFixed:
      return options_.fixed_threshold;
  }
  return 0;
}

}  // namespace cairn
