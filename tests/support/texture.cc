#include "tests/support/texture.h"

#include <opencv2/imgproc.hpp>

namespace cairn::synthetic {

Texture::Texture(const cv::Mat& image, double pixels_per_metre)
    : pixels_per_metre_(pixels_per_metre) {
  cv::Mat current = image;
  for (;;) {
    Level level;
    level.width = current.cols;
    level.height = current.rows;
    level.scale_x = static_cast<float>(current.cols) / static_cast<float>(image.cols);
    level.scale_y = static_cast<float>(current.rows) / static_cast<float>(image.rows);
    cv::Mat fixed;
    current.convertTo(fixed, CV_16U, 256.0);
    level.texels.assign(fixed.ptr<std::uint16_t>(), fixed.ptr<std::uint16_t>() + fixed.total());
    levels_.push_back(std::move(level));
    const cv::Size half((current.cols + 1) / 2, (current.rows + 1) / 2);
    if (half.width < 2 || half.height < 2 || half == current.size()) break;
    cv::Mat smaller;
    cv::resize(current, smaller, half, 0, 0, cv::INTER_AREA);
    current = smaller;
  }
}

Texture::Footprint Texture::footprint(float a, float b, float c, float d) const {
  const float right = std::sqrt(a * a + c * c), down = std::sqrt(b * b + d * d);
  const float major = std::max({right, down, 1e-6f});
  const float minor = std::abs(a * d - b * c) / major;
  const float width = std::max(minor, major / kMaxTaps);
  Footprint result;
  result.lod = std::clamp(std::log2(std::max(width, 1.0f)), 0.0f,
                          static_cast<float>(levels_.size()) - 1.001f);
  if (major > 1.0f) {
    const float ratio = major / std::max(width, 1.0f);
    result.taps = std::clamp(static_cast<int>(std::ceil(ratio - 0.25f)), 1, kMaxTaps);
  }
  result.step_u = right >= down ? a : b;
  result.step_v = right >= down ? c : d;
  return result;
}

}  // namespace cairn::synthetic
