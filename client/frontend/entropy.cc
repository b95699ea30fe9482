#include "client/frontend/entropy.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace cairn {
namespace {

constexpr int kBits = 14;  // after the binary point
// n log2 n for the counts that occur in blocks of ordinary size, in whole 2^-14 bits: sums come out
// the same in any order.
constexpr std::size_t kTableSize = 16384;
const std::array<std::uint32_t, kTableSize>& n_log_n_table() {
  static const auto table = [] {
    std::array<std::uint32_t, kTableSize> t{};
    for (std::size_t n = 2; n < kTableSize; ++n)
      t[n] = static_cast<std::uint32_t>(
          std::lround(static_cast<double>(n) * std::log2(static_cast<double>(n)) * (1 << kBits)));
    return t;
  }();
  return table;
}

using Counts = std::array<std::uint16_t, 256>;
using Histogram = std::array<std::uint32_t, 256>;

Counts count(const cv::Mat& block, const Kernels& kernels) {
  alignas(64) Counts counts;
  kernels.histogram(block.ptr<std::uint8_t>(), static_cast<std::ptrdiff_t>(block.step), block.cols,
                    block.rows, counts.data());
  return counts;
}

// Of a block of any size, in strips that the kernel can count.
Histogram histogram(const cv::Mat& block, const Kernels& kernels) {
  Histogram sum{};
  const int strip = std::max(1, 65535 / block.cols);
  for (int y = 0; y < block.rows; y += strip) {
    const Counts counts = count(block.rowRange(y, std::min(block.rows, y + strip)), kernels);
    for (std::size_t i = 0; i < 256; ++i) sum[i] += counts[i];
  }
  return sum;
}

// H = -sum c/n log2(c/n) = log2 n - (sum c log2 c) / n, over the histogram's counts c.
double entropy_of_sum(double sum, double pixels) {
  return std::max(0.0, std::log2(pixels) - sum / pixels);
}

double histogram_entropy(const Histogram& h, double pixels) {
  double sum = 0;
  for (const std::uint32_t c : h) sum += c > 0 ? c * std::log2(static_cast<double>(c)) : 0.0;
  return entropy_of_sum(sum, pixels);
}

// For blocks whose every count is in the table: the sum then fits too, as n log2 n of the whole.
double small_block_entropy(const cv::Mat& block, const Kernels& kernels) {
  const Counts counts = count(block, kernels);
  const auto& table = n_log_n_table();
  std::uint32_t sum = 0;
  for (const std::uint16_t c : counts) sum += table[c];
  return entropy_of_sum(static_cast<double>(sum) / (1 << kBits),
                        static_cast<double>(block.total()));
}

// Pixels of grey level g all have the share g / S: H = log2 S - (sum count(g) g log2 g) / S.
double share_entropy(const Histogram& h) {
  double total = 0, sum = 0;
  for (std::size_t g = 1; g < 256; ++g) {
    const double share = static_cast<double>(h[g]) * static_cast<double>(g);
    total += share;
    sum += share * std::log2(static_cast<double>(g));
  }
  return total > 0 ? std::max(0.0, std::log2(total) - sum / total) : 0.0;
}

}  // namespace

double entropy(const cv::Mat& block, EntropyVariant variant, const Kernels& kernels) {
  if (block.empty()) return 0;
  if (variant == EntropyVariant::kShares) return share_entropy(histogram(block, kernels));
  if (block.total() < kTableSize) return small_block_entropy(block, kernels);
  return histogram_entropy(histogram(block, kernels), static_cast<double>(block.total()));
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

int BlockGrid::at(int x, int y) const {
  const auto cell = [](int i, int cells, int length) { return ((i + 1) * cells - 1) / length; };
  return cell(y, rows_, image_.height) * columns_ + cell(x, columns_, image_.width);
}

void append_block_entropies(const cv::Mat& image, const BlockGrid& grid, EntropyVariant variant,
                            std::vector<float>& entropies, const Kernels& kernels) {
  for (int i = 0; i < grid.size(); ++i)
    entropies.push_back(static_cast<float>(entropy(image(grid.area(i)), variant, kernels)));
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
