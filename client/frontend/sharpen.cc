#include "client/frontend/sharpen.h"

#include <algorithm>
#include <cstdint>

namespace cairn {
namespace {

std::uint8_t clamped(int value) {
  return static_cast<std::uint8_t>(std::clamp(value, 0, 255));
}

// 16-bit arithmetic on plain arrays: the compiler turns it into vector code.
void sharpen_row(const std::uint8_t* __restrict above, const std::uint8_t* __restrict row,
                 const std::uint8_t* __restrict below, int begin, int end,
                 std::uint8_t* __restrict out) {
  for (int x = begin; x < end; ++x) {
    const auto value =
        static_cast<std::int16_t>(5 * row[x] - row[x - 1] - row[x + 1] - above[x] - below[x]);
    out[x] =
        static_cast<std::uint8_t>(std::min<std::int16_t>(255, std::max<std::int16_t>(0, value)));
  }
}

}  // namespace

void sharpen(const cv::Mat& in, const cv::Rect& area, cv::Mat& out) {
  const int last_row = in.rows - 1, last_column = in.cols - 1;
  const int left = area.x, right = area.x + area.width;
  for (int y = area.y; y < area.y + area.height; ++y) {
    const std::uint8_t* row = in.ptr<std::uint8_t>(y);
    const std::uint8_t* above = in.ptr<std::uint8_t>(std::max(0, y - 1));
    const std::uint8_t* below = in.ptr<std::uint8_t>(std::min(last_row, y + 1));
    std::uint8_t* result = out.ptr<std::uint8_t>(y);
    sharpen_row(above, row, below, std::max(1, left), std::min(last_column, right), result);
    const auto border = [&](int x) {
      result[x] = clamped(5 * row[x] - row[std::max(0, x - 1)] - row[std::min(last_column, x + 1)] -
                          above[x] - below[x]);
    };
    if (left == 0) border(0);
    if (right == in.cols) border(last_column);
  }
}

}  // namespace cairn
