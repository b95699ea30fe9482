#include "client/frontend/describe.h"

#include <cmath>

#include <opencv2/core/hal/intrin.hpp>
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

Descriptor Describer::describe(const cv::Mat& smoothed, int x, int y, float angle) const {
  const auto step = std::lround(angle * (kAngles / static_cast<float>(2 * M_PI)));
  const auto first = static_cast<std::size_t>(step & (kAngles - 1)) * kPoints;
  const std::uint8_t* centre = smoothed.ptr<std::uint8_t>(y) + x;
  const int stride = static_cast<int>(smoothed.step);

  // In three loops, of which the first and the last are vector code.
  alignas(64) std::int32_t offsets[kPoints];
  for (std::size_t i = 0; i < kPoints; ++i) offsets[i] = y_[first + i] * stride + x_[first + i];
  alignas(64) std::uint8_t values[kPoints];
  for (std::size_t i = 0; i < kPoints; ++i) values[i] = centre[offsets[i]];
  Descriptor d{};
  for (std::size_t i = 0; i < kBriefTests; i += 16) {
    const auto darker =
        cv::v_load_aligned(values + i) < cv::v_load_aligned(values + kBriefTests + i);
    const auto bits = static_cast<std::uint64_t>(cv::v_signmask(cv::v_reinterpret_as_s8(darker)));
    d[i / 64] |= (bits & 0xffff) << (i % 64);
  }
  return d;
}

}  // namespace cairn
