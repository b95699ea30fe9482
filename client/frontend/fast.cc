#include "client/frontend/fast.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/features2d.hpp>

namespace cairn {
namespace {

constexpr int kCircleRadius = 3;
constexpr std::size_t kCircle = 16;  // pixels
constexpr std::size_t kArc = 9;      // of them in a row make a corner
constexpr std::array<int, kCircle> kCircleX = {0, 1,  2,  3,  3,  3,  2,  1,
                                               0, -1, -2, -3, -3, -3, -2, -1};
constexpr std::array<int, kCircle> kCircleY = {-3, -3, -2, -1, 0, 1,  2,  3,
                                               3,  3,  2,  1,  0, -1, -2, -3};

// Sixteen pixels at a time.
using Lanes = cv::v_uint8x16;
using Circle = std::array<Lanes, kCircle>;

// The greatest, over all arcs of the circle, of the least contrast on the arc. The least of 2, 4
// and 8 pixels in a row by doubling, then of 9.
Lanes best_arc(const Circle& contrast) {
  static_assert(kArc == 9);
  Circle two, four;
  for (std::size_t i = 0; i < kCircle; ++i)
    two[i] = cv::v_min(contrast[i], contrast[(i + 1) % kCircle]);
  for (std::size_t i = 0; i < kCircle; ++i) four[i] = cv::v_min(two[i], two[(i + 2) % kCircle]);
  Lanes best = cv::v_setzero_u8();
  for (std::size_t i = 0; i < kCircle; ++i) {
    const Lanes eight = cv::v_min(four[i], four[(i + 4) % kCircle]);
    best = cv::v_max(best, cv::v_min(eight, contrast[(i + 8) % kCircle]));
  }
  return best;
}

// Scores of sixteen pixels, given them and the circles around them. Differences stop at 0.
Lanes scores(const Lanes& centre, const Circle& around) {
  Circle brighter, darker;
  for (std::size_t i = 0; i < kCircle; ++i) {
    brighter[i] = around[i] - centre;
    darker[i] = centre - around[i];
  }
  return cv::v_max(best_arc(brighter), best_arc(darker));
}

// Four rows of four pixels; the first pixel is at `from`.
Lanes load_4x4(const std::uint8_t* from, std::ptrdiff_t stride) {
  alignas(16) std::uint8_t pixels[16];
  for (std::ptrdiff_t r = 0; r < 4; ++r) std::memcpy(pixels + 4 * r, from + r * stride, 4);
  return cv::v_load_aligned(pixels);
}

// Scores of the 4 x 4 pixels from `first` on.
Lanes scores_4x4(const std::uint8_t* first, std::ptrdiff_t stride) {
  Circle around;
  for (std::size_t i = 0; i < kCircle; ++i)
    around[i] = load_4x4(first + kCircleY[i] * stride + kCircleX[i], stride);
  return scores(load_4x4(first, stride), around);
}

}  // namespace

int fast_score(const cv::Mat& image, int x, int y) {
  Circle around;
  for (std::size_t i = 0; i < kCircle; ++i)
    around[i] = cv::v_setall_u8(image.at<std::uint8_t>(y + kCircleY[i], x + kCircleX[i]));
  return scores(cv::v_setall_u8(image.at<std::uint8_t>(y, x)), around).get0();
}

cv::Point2f subpixel_corner(const cv::Mat& image, int x, int y) {
  alignas(16) std::uint8_t score[16];
  cv::v_store_aligned(score, scores_4x4(image.ptr<std::uint8_t>(y - 1) + x - 1,
                                        static_cast<std::ptrdiff_t>(image.step)));
  float s[3][3];
  for (int v = 0; v < 3; ++v)
    for (int u = 0; u < 3; ++u) s[v][u] = score[4 * v + u];
  // s(u, v) ~ c + gx u + gy v + (hxx u^2 + 2 hxy u v + hyy v^2) / 2, fitted to nine values.
  float gx = 0, gy = 0, hxx = 0, hyy = 0;
  for (int i = 0; i < 3; ++i) {
    gx += (s[i][2] - s[i][0]) / 6;
    gy += (s[2][i] - s[0][i]) / 6;
    hxx += (s[i][0] - 2 * s[i][1] + s[i][2]) / 3;
    hyy += (s[0][i] - 2 * s[1][i] + s[2][i]) / 3;
  }
  const float hxy = (s[2][2] - s[2][0] - s[0][2] + s[0][0]) / 4;
  const float determinant = hxx * hyy - hxy * hxy;
  const cv::Point2f at(static_cast<float>(x), static_cast<float>(y));
  if (!(determinant > 0 && hxx < 0)) return at;  // no peak
  return at + cv::Point2f(std::clamp((hxy * gy - hyy * gx) / determinant, -0.5f, 0.5f),
                          std::clamp((hxy * gx - hxx * gy) / determinant, -0.5f, 0.5f));
}

// The circle of corners in `area` reaches kCircleRadius pixels beyond it.
void FastDetector::append(const cv::Mat& level, const cv::Rect& area, int threshold,
                          std::vector<Corner>& corners) {
  const cv::Rect reached(area.x - kCircleRadius, area.y - kCircleRadius,
                         area.width + 2 * kCircleRadius, area.height + 2 * kCircleRadius);
  cv::FAST(level(reached), found_, threshold, true, cv::FastFeatureDetector::TYPE_9_16);
  for (const cv::KeyPoint& k : found_)
    corners.push_back({static_cast<std::int16_t>(static_cast<int>(k.pt.x) + reached.x),
                       static_cast<std::int16_t>(static_cast<int>(k.pt.y) + reached.y),
                       static_cast<std::int16_t>(k.response)});
}

void FastDetector::detect(const cv::Mat& level, int border, std::vector<Corner>& corners) {
  corners.clear();
  const cv::Rect area(border, border, level.cols - 2 * border, level.rows - 2 * border);
  if (area.width <= 0 || area.height <= 0) return;
  append(level, area, options_.high_threshold, corners);
  if (options_.low_threshold <= 0) return;

  const int columns = std::max(1, (area.width + options_.cell / 2) / options_.cell);
  const int rows = std::max(1, (area.height + options_.cell / 2) / options_.cell);
  occupied_.assign(static_cast<std::size_t>(columns * rows), 0);
  for (const Corner& c : corners) {
    const int column = (c.x - area.x) * columns / area.width;
    const int row = (c.y - area.y) * rows / area.height;
    occupied_[static_cast<std::size_t>(row * columns + column)] = 1;
  }
  // Cell i covers the pixels x with x * columns / width == i, as above.
  const auto edge = [](int i, int length, int cells) { return (i * length + cells - 1) / cells; };
  for (int row = 0; row < rows; ++row) {
    const int top = edge(row, area.height, rows), bottom = edge(row + 1, area.height, rows);
    const std::uint8_t* occupied = &occupied_[static_cast<std::size_t>(row * columns)];
    for (int first = 0; first < columns; ++first) {
      if (occupied[first]) continue;
      int last = first;  // of the empty cells side by side: they are searched in one go
      while (last + 1 < columns && !occupied[last + 1]) ++last;
      const int left = edge(first, area.width, columns),
                right = edge(last + 1, area.width, columns);
      append(level, {area.x + left, area.y + top, right - left, bottom - top},
             options_.low_threshold, corners);
      first = last;
    }
  }
}

}  // namespace cairn
