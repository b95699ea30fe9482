#include "client/frontend/sharpen.h"

#include <algorithm>
#include <cstdint>

namespace cairn {
namespace {

std::uint8_t clamped(int value) {
  return static_cast<std::uint8_t>(std::clamp(value, 0, 255));
}

}  // namespace

void sharpen(const cv::Mat& in, const cv::Rect& area, cv::Mat& out, const Kernels& kernels) {
  const int last_row = in.rows - 1, last_column = in.cols - 1;
  const int left = area.x, right = area.x + area.width;
  for (int y = area.y; y < area.y + area.height; ++y) {
    const std::uint8_t* row = in.ptr<std::uint8_t>(y);
    const std::uint8_t* above = in.ptr<std::uint8_t>(std::max(0, y - 1));
    const std::uint8_t* below = in.ptr<std::uint8_t>(std::min(last_row, y + 1));
    std::uint8_t* result = out.ptr<std::uint8_t>(y);
    kernels.sharpen_row(above, row, below, std::max(1, left), std::min(last_column, right), result);
    const auto border = [&](int x) {
      result[x] = clamped(5 * row[x] - row[std::max(0, x - 1)] - row[std::min(last_column, x + 1)] -
                          above[x] - below[x]);
    };
    if (left == 0) border(0);
    if (right == in.cols) border(last_column);
  }
}

}  // namespace cairn
