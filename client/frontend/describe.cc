#include "client/frontend/describe.h"

#include <cmath>

namespace cairn {
namespace {

constexpr int kAngles = 128;
constexpr int kPoints = 2 * kBriefTests;
constexpr int kSmoothRadius = 3;

std::int16_t rounded(double value) {
  return static_cast<std::int16_t>(std::lround(value));
}

// The pixel that stands for one beyond the border: ... 2 1 | 0 1 2 ...
int mirrored(int i, int size) {
  if (size == 1) return 0;
  while (i < 0 || i >= size) i = i < 0 ? -i : 2 * (size - 1) - i;
  return i;
}

}  // namespace

void smooth(const cv::Mat& in, cv::Mat& out, std::vector<std::uint16_t>& scratch,
            const Kernels& kernels) {
  const int width = in.cols;
  scratch.resize(static_cast<std::size_t>(width + 2 * kSmoothRadius));
  std::uint16_t* const line = scratch.data() + kSmoothRadius;
  for (int y = 0; y < in.rows; ++y) {
    const std::uint8_t* rows[2 * kSmoothRadius + 1];
    for (int i = -kSmoothRadius; i <= kSmoothRadius; ++i)
      rows[i + kSmoothRadius] = in.ptr<std::uint8_t>(mirrored(y + i, in.rows));
    kernels.blur_down(rows, width, line);
    for (int i = 1; i <= kSmoothRadius; ++i) {
      line[-i] = line[mirrored(-i, width)];
      line[width - 1 + i] = line[mirrored(width - 1 + i, width)];
    }
    kernels.blur_across(line, width, out.ptr<std::uint8_t>(y));
  }
}

void smooth(const cv::Mat& in, cv::Mat& out) {
  std::vector<std::uint16_t> scratch;
  smooth(in, out, scratch);
}

Describer::Describer(std::span<const BriefTest, kBriefTests> tests, const Kernels& kernels)
    : kernels_(&kernels) {
  x_.reserve(static_cast<std::size_t>(kAngles) * kPoints);
  y_.reserve(static_cast<std::size_t>(kAngles) * kPoints);
  for (int i = 0; i < kAngles; ++i) {
    const double angle = 2 * M_PI * i / kAngles, c = std::cos(angle), s = std::sin(angle);
    const auto add = [&](int x, int y) {
      x_.push_back(rounded(c * x - s * y));
      y_.push_back(rounded(s * x + c * y));
    };
    for (const BriefTest& t : tests) add(t.ax, t.ay);
    for (const BriefTest& t : tests) add(t.bx, t.by);
  }
}

void Describer::place(std::ptrdiff_t stride) {
  if (stride == stride_) return;
  stride_ = stride;
  offsets_.resize(x_.size());
  for (std::size_t i = 0; i < x_.size(); ++i)
    offsets_[i] = static_cast<std::int32_t>(y_[i] * stride + x_[i]);
}

Descriptor Describer::describe(const cv::Mat& smoothed, int x, int y, float angle) {
  place(static_cast<std::ptrdiff_t>(smoothed.step));
  const auto step = std::lround(angle * (kAngles / static_cast<float>(2 * M_PI)));
  const std::int32_t* const first =
      &offsets_[static_cast<std::size_t>(step & (kAngles - 1)) * kPoints];
  Descriptor d{};
  kernels_->describe(smoothed.ptr<std::uint8_t>(y) + x, first, first + kBriefTests, d.data());
  return d;
}

}  // namespace cairn
