#include "client/frontend/describe.h"

#include <cmath>

#include <opencv2/imgproc.hpp>

namespace cairn {
namespace {

constexpr int kAngles = 128;
constexpr int kPoints = 2 * kBriefTests;
constexpr double kSmoothSigma = 2.0;
constexpr int kSmoothSize = 7;

std::int16_t rounded(double value) {
  return static_cast<std::int16_t>(std::lround(value));
}

}  // namespace

void smooth(const cv::Mat& in, cv::Mat& out) {
  cv::GaussianBlur(in, out, {kSmoothSize, kSmoothSize}, kSmoothSigma, kSmoothSigma,
                   cv::BORDER_REFLECT_101);
}

Describer::Describer(std::span<const BriefTest, kBriefTests> tests) {
  offsets_.reserve(static_cast<std::size_t>(kAngles) * kPoints);
  for (int i = 0; i < kAngles; ++i) {
    const double angle = 2 * M_PI * i / kAngles, c = std::cos(angle), s = std::sin(angle);
    const auto add = [&](int x, int y) {
      offsets_.push_back({rounded(c * x - s * y), rounded(s * x + c * y)});
    };
    for (const BriefTest& t : tests) add(t.ax, t.ay);
    for (const BriefTest& t : tests) add(t.bx, t.by);
  }
}

Descriptor Describer::describe(const cv::Mat& smoothed, int x, int y, float angle) const {
  const auto step = std::lround(angle * (kAngles / static_cast<float>(2 * M_PI)));
  const Offset* offsets = &offsets_[static_cast<std::size_t>(step & (kAngles - 1)) * kPoints];
  const std::uint8_t* centre = smoothed.ptr<std::uint8_t>(y) + x;
  const int stride = static_cast<int>(smoothed.step);

  // Gather first, compare afterwards: the comparison then is vector code.
  alignas(64) std::uint8_t values[kPoints];
  for (int i = 0; i < kPoints; ++i) values[i] = centre[offsets[i].y * stride + offsets[i].x];
  Descriptor d;
  for (std::size_t word = 0; word < d.size(); ++word) {
    const std::uint8_t* a = values + 64 * word;
    const std::uint8_t* b = a + kBriefTests;
    std::uint64_t bits = 0;
    for (int i = 0; i < 64; ++i) bits |= static_cast<std::uint64_t>(a[i] < b[i]) << i;
    d[word] = bits;
  }
  return d;
}

}  // namespace cairn
