#include "client/frontend/fast.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

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

// The greatest, over all arcs of the circle, of the least contrast on the arc. `contrast` holds the
// circle twice in a row, so that arcs need no wrapping; lengths are doubled 1, 2, 4, 8, then 9.
int best_arc(const std::int16_t* contrast) {
  static_assert(kArc == 9);
  std::int16_t two[kCircle + 6], four[kCircle + 4], best = -256;
  for (std::size_t i = 0; i < kCircle + 6; ++i) two[i] = std::min(contrast[i], contrast[i + 1]);
  for (std::size_t i = 0; i < kCircle + 4; ++i) four[i] = std::min(two[i], two[i + 2]);
  for (std::size_t i = 0; i < kCircle; ++i) {
    const std::int16_t eight = std::min(four[i], four[i + 4]);
    best = std::max(best, std::min(eight, contrast[i + 8]));
  }
  return best;
}

int score_at(const std::uint8_t* centre, const std::array<std::ptrdiff_t, kCircle>& circle) {
  alignas(64) std::int16_t brighter[2 * kCircle], darker[2 * kCircle];
  const int level = *centre;
  for (std::size_t i = 0; i < kCircle; ++i)
    brighter[i] = brighter[i + kCircle] = static_cast<std::int16_t>(centre[circle[i]] - level);
  for (std::size_t i = 0; i < 2 * kCircle; ++i) darker[i] = static_cast<std::int16_t>(-brighter[i]);
  return std::max(best_arc(brighter), best_arc(darker));
}

std::array<std::ptrdiff_t, kCircle> circle_offsets(const cv::Mat& image) {
  std::array<std::ptrdiff_t, kCircle> offsets;
  for (std::size_t i = 0; i < kCircle; ++i)
    offsets[i] = kCircleY[i] * static_cast<std::ptrdiff_t>(image.step) + kCircleX[i];
  return offsets;
}

}  // namespace

int fast_score(const cv::Mat& image, int x, int y) {
  return score_at(image.ptr<std::uint8_t>(y) + x, circle_offsets(image));
}

cv::Point2f subpixel_corner(const cv::Mat& image, int x, int y) {
  const auto circle = circle_offsets(image);
  float s[3][3];
  for (int v = 0; v < 3; ++v)
    for (int u = 0; u < 3; ++u)
      s[v][u] =
          static_cast<float>(score_at(image.ptr<std::uint8_t>(y + v - 1) + x + u - 1, circle));
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
  for (int i = 0; i < columns * rows; ++i) {
    if (occupied_[static_cast<std::size_t>(i)]) continue;
    const int left = edge(i % columns, area.width, columns);
    const int right = edge(i % columns + 1, area.width, columns);
    const int top = edge(i / columns, area.height, rows);
    const int bottom = edge(i / columns + 1, area.height, rows);
    append(level, {area.x + left, area.y + top, right - left, bottom - top}, options_.low_threshold,
           corners);
  }
}

}  // namespace cairn
