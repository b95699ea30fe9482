#include "client/frontend/fast.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include <opencv2/core/hal/intrin.hpp>

namespace cairn {
namespace {

constexpr int kLanes = 16;           // pixels in a vector
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

using Offsets = std::array<std::ptrdiff_t, kCircle>;
Offsets circle_offsets(const cv::Mat& image) {
  Offsets offsets;
  for (std::size_t i = 0; i < kCircle; ++i)
    offsets[i] = kCircleY[i] * static_cast<std::ptrdiff_t>(image.step) + kCircleX[i];
  return offsets;
}

Lanes scores_16(const std::uint8_t* first, const Offsets& offsets) {
  Circle around;
  for (std::size_t i = 0; i < kCircle; ++i) around[i] = cv::v_load(first + offsets[i]);
  return scores(cv::v_load(first), around);
}

// False for most pixels: an arc of nine holds two neighbours of any four that lie a quarter circle
// apart, so both pairs of opposites must have one that stands out, on the same side.
bool may_be_corner(const std::uint8_t* first, const Offsets& offsets, const Lanes& limit) {
  const Lanes centre = cv::v_load(first);
  Lanes possible = cv::v_setall_u8(255);
  for (const std::size_t start : {0u, 2u}) {
    const Lanes a = cv::v_load(first + offsets[start]), b = cv::v_load(first + offsets[start + 4]);
    const Lanes c = cv::v_load(first + offsets[start + 8]);
    const Lanes d = cv::v_load(first + offsets[start + 12]);
    const Lanes brighter =
        cv::v_min(cv::v_max(a - centre, c - centre), cv::v_max(b - centre, d - centre));
    const Lanes darker =
        cv::v_min(cv::v_max(centre - a, centre - c), cv::v_max(centre - b, centre - d));
    possible = cv::v_min(possible, cv::v_max(brighter, darker));
    if (!cv::v_check_any(possible > limit)) return false;
  }
  return true;
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

// Scores of the corners with a contrast above `threshold` into scores_, 0 elsewhere. scores_ has a
// margin of one pixel around `area`.
void FastDetector::score(const cv::Mat& level, const cv::Rect& area, int threshold) {
  stride_ = static_cast<std::size_t>(area.width) + 2 + kLanes;  // whole vectors may be read
  scores_.assign(stride_ * static_cast<std::size_t>(area.height + 2), 0);
  const auto offsets = circle_offsets(level);
  const Lanes limit = cv::v_setall_u8(static_cast<std::uint8_t>(threshold));
  for (int y = 0; y < area.height; ++y) {
    const std::uint8_t* row = level.ptr<std::uint8_t>(area.y + y) + area.x;
    std::uint8_t* out = &scores_[stride_ * static_cast<std::size_t>(y + 1) + 1];
    int x = 0;
    for (; x < area.width; x += kLanes) {
      // The last vector overlaps the one before: nothing outside the area is touched.
      if (x + kLanes > area.width) x = area.width - kLanes;
      if (x < 0) break;
      if (!may_be_corner(row + x, offsets, limit)) continue;
      const Lanes s = scores_16(row + x, offsets);
      cv::v_store(out + x, s & (s > limit));
    }
    if (area.width >= kLanes) continue;
    for (x = 0; x < area.width; ++x) {
      const int s = fast_score(level, area.x + x, area.y + y);
      out[x] = static_cast<std::uint8_t>(s > threshold ? s : 0);
    }
  }
}

// Appends the corners in scores_ that no neighbour exceeds. Of equal neighbours the last remains.
void FastDetector::collect(const cv::Rect& area, std::vector<Corner>& corners) const {
  for (int y = 0; y < area.height; ++y) {
    const std::uint8_t* row = &scores_[stride_ * static_cast<std::size_t>(y + 1) + 1];
    const std::uint8_t *above = row - stride_, *below = row + stride_;
    for (int x = 0; x < area.width; x += kLanes) {
      const Lanes s = cv::v_load(row + x);
      if (!cv::v_check_any(s > cv::v_setzero_u8())) continue;
      const Lanes before = cv::v_max(cv::v_max(cv::v_load(above + x - 1), cv::v_load(above + x)),
                                     cv::v_max(cv::v_load(above + x + 1), cv::v_load(row + x - 1)));
      const Lanes after = cv::v_max(cv::v_max(cv::v_load(row + x + 1), cv::v_load(below + x - 1)),
                                    cv::v_max(cv::v_load(below + x), cv::v_load(below + x + 1)));
      const Lanes peak = (s > after) & (s >= before);
      auto bits = static_cast<std::uint32_t>(cv::v_signmask(cv::v_reinterpret_as_s8(peak)));
      for (; bits != 0; bits &= bits - 1) {
        const int i = x + std::countr_zero(bits);
        if (i < area.width)
          corners.push_back({static_cast<std::int16_t>(area.x + i),
                             static_cast<std::int16_t>(area.y + y), row[i]});
      }
    }
  }
}

void FastDetector::append(const cv::Mat& level, const cv::Rect& area, int threshold,
                          std::vector<Corner>& corners) {
  score(level, area, threshold);
  collect(area, corners);
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
