#include "client/frontend/fast.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace cairn {
namespace {

constexpr std::size_t kCircle = 16;  // pixels; nine of them in a row make a corner
constexpr std::array<int, kCircle> kCircleX = {0, 1,  2,  3,  3,  3,  2,  1,
                                               0, -1, -2, -3, -3, -3, -2, -1};
constexpr std::array<int, kCircle> kCircleY = {-3, -3, -2, -1, 0, 1,  2,  3,
                                               3,  3,  2,  1,  0, -1, -2, -3};

using Offsets = std::array<std::ptrdiff_t, kCircle>;
Offsets circle_offsets(const cv::Mat& image) {
  Offsets offsets;
  for (std::size_t i = 0; i < kCircle; ++i)
    offsets[i] = kCircleY[i] * static_cast<std::ptrdiff_t>(image.step) + kCircleX[i];
  return offsets;
}

constexpr int kSide = 4;  // of the square of pixels that fast_scores_16 takes

// Four rows of four pixels; the first pixel is at `from`.
void load_square(const std::uint8_t* from, std::ptrdiff_t stride, std::uint8_t* pixels) {
  for (std::ptrdiff_t r = 0; r < kSide; ++r)
    std::memcpy(pixels + kSide * r, from + r * stride, kSide);
}

// Scores of the 4 x 4 pixels from `first` on.
void score_square(const std::uint8_t* first, std::ptrdiff_t stride, const Kernels& kernels,
                  std::uint8_t* out) {
  alignas(16) std::uint8_t around[kCircle][16], centre[16];
  for (std::size_t i = 0; i < kCircle; ++i)
    load_square(first + kCircleY[i] * stride + kCircleX[i], stride, around[i]);
  load_square(first, stride, centre);
  kernels.fast_scores_16(around, centre, out);
}

}  // namespace

int fast_score(const cv::Mat& image, int x, int y) {
  const Offsets offsets = circle_offsets(image);
  std::uint8_t score = 0;
  baseline_kernels().fast_scores(image.ptr<std::uint8_t>(y) + x, 1, offsets.data(), 0, &score);
  return score;
}

cv::Point2f subpixel_corner(const cv::Mat& image, int x, int y, const Kernels& kernels) {
  alignas(16) std::uint8_t score[16];
  score_square(image.ptr<std::uint8_t>(y - 1) + x - 1, static_cast<std::ptrdiff_t>(image.step),
               kernels, score);
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

// A row is searched for peaks as soon as the next one has its scores, so that scores stay in the
// nearest cache. They have a margin of one pixel around `area`.
void FastDetector::append(const cv::Mat& level, const cv::Rect& area, int threshold,
                          std::vector<Corner>& corners) {
  const std::size_t stride = static_cast<std::size_t>(area.width) + 1 + kFastSpare;
  scores_.assign(3 * stride, 0);
  peaks_.resize(static_cast<std::size_t>(area.width));
  const auto scores_of = [&](int y) {
    return &scores_[static_cast<std::size_t>((y + 3) % 3) * stride + 1];
  };
  const auto circle = circle_offsets(level);
  for (int y = 0; y <= area.height; ++y) {
    std::uint8_t* const row = scores_of(y);
    std::memset(row, 0, static_cast<std::size_t>(area.width));
    if (y < area.height)
      kernels_->fast_scores(level.ptr<std::uint8_t>(area.y + y) + area.x, area.width, circle.data(),
                            static_cast<std::uint8_t>(threshold), row);
    if (y == 0) continue;
    const std::uint8_t* const before = scores_of(y - 1);
    const int found =
        kernels_->fast_peaks(scores_of(y - 2), before, row, area.width, peaks_.data());
    for (int i = 0; i < found; ++i) {
      const std::uint16_t x = peaks_[static_cast<std::size_t>(i)];
      corners.push_back({static_cast<std::int16_t>(area.x + x),
                         static_cast<std::int16_t>(area.y + y - 1), before[x]});
    }
  }
}

void FastDetector::detect(const cv::Mat& level, int border, int low_threshold,
                          std::vector<Corner>& corners) {
  corners.clear();
  const cv::Rect area(border, border, level.cols - 2 * border, level.rows - 2 * border);
  if (area.width <= 0 || area.height <= 0) return;
  append(level, area, options_.high_threshold, corners);
  if (low_threshold <= 0) return;

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
      append(level, {area.x + left, area.y + top, right - left, bottom - top}, low_threshold,
             corners);
      first = last;
    }
  }
}

}  // namespace cairn
