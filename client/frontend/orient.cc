#include "client/frontend/orient.h"

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace cairn {

float orientation(const cv::Mat& image, int x, int y, const Kernels& kernels) {
  const Moments m =
      kernels.disc_moments(image.ptr<std::uint8_t>(y) + x, static_cast<std::ptrdiff_t>(image.step));
  const float angle = std::atan2(static_cast<float>(m.y), static_cast<float>(m.x));
  constexpr auto kTurn = static_cast<float>(2 * M_PI);
  const float positive = angle < 0 ? angle + kTurn : angle;
  return positive < kTurn ? positive : 0.0f;
}

}  // namespace cairn
