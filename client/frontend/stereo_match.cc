#include "client/frontend/stereo_match.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

constexpr int kWindow = 5;  // 11 x 11 pixels
constexpr int kSlide = 5;   // pixels of the level to either side of the descriptor's match
constexpr float kOutlierFactor = 2.1f;  // times the median difference of all matches

struct Refined {
  float x;         // pixels of the level
  int difference;  // of the windows at the best whole pixel
};

// Sum of absolute differences of the two windows, brightness of the centres taken off: the two
// cameras need not expose alike.
int window_difference(const cv::Mat& left, const cv::Mat& right, int xl, int xr, int y) {
  const int offset = left.at<std::uint8_t>(y, xl) - right.at<std::uint8_t>(y, xr);
  int sum = 0;
  for (int v = -kWindow; v <= kWindow; ++v) {
    const std::uint8_t* l = left.ptr<std::uint8_t>(y + v) + xl;
    const std::uint8_t* r = right.ptr<std::uint8_t>(y + v) + xr;
    for (int u = -kWindow; u <= kWindow; ++u) sum += std::abs(l[u] - r[u] - offset);
  }
  return sum;
}

// Slides the right window along the row, then puts a parabola through the least difference and its
// neighbours. Nothing where the least lies at the end of the slide or at the images' edges.
std::optional<Refined> slide(const cv::Mat& left, const cv::Mat& right, int xl, int xr, int y) {
  if (y < kWindow || y + kWindow >= left.rows || xl < kWindow || xl + kWindow >= left.cols ||
      xr < kWindow + kSlide || xr + kWindow + kSlide >= right.cols)
    return std::nullopt;
  int differences[2 * kSlide + 1];
  int best = 0;
  for (int i = 0; i <= 2 * kSlide; ++i) {
    differences[i] = window_difference(left, right, xl, xr + i - kSlide, y);
    if (differences[i] < differences[best]) best = i;
  }
  if (best == 0 || best == 2 * kSlide) return std::nullopt;
  const int before = differences[best - 1], after = differences[best + 1];
  const int curvature = before + after - 2 * differences[best];
  if (curvature <= 0) return std::nullopt;
  const float shift = 0.5f * static_cast<float>(before - after) / static_cast<float>(curvature);
  return Refined{static_cast<float>(xr + best - kSlide) + shift, differences[best]};
}

}  // namespace

// Counting sort: a right feature is entered in every row of its band.
void StereoMatcher::sort_by_row(const Pyramid& images, const Features& right) {
  const int rows = images.sizes().front().height;
  row_starts_.assign(static_cast<std::size_t>(rows) + 1, 0);
  const auto for_rows = [&](const Feature& f, auto&& visit) {
    const float band = options_.row_band * images.scale_x(f.octave);
    const int first = std::max(0, static_cast<int>(std::floor(f.y - band)));
    const int last = std::min(rows - 1, static_cast<int>(std::ceil(f.y + band)));
    for (int r = first; r <= last; ++r) visit(static_cast<std::size_t>(r));
  };
  for (const Feature& f : right.points) for_rows(f, [&](std::size_t r) { ++row_starts_[r]; });
  std::uint32_t sum = 0;
  for (std::uint32_t& start : row_starts_) {
    sum += start;
    start = sum;  // one past the row's last entry; filling from the back moves it to the first
  }
  by_row_.resize(sum);
  for (std::size_t i = right.size(); i-- > 0;)
    for_rows(right.points[i],
             [&](std::size_t r) { by_row_[--row_starts_[r]] = static_cast<std::uint32_t>(i); });
}

int StereoMatcher::best_candidate(const Feature& point, const Descriptor& descriptor,
                                  const Features& right) const {
  const auto row = static_cast<std::size_t>(std::clamp(static_cast<int>(std::lround(point.y)), 0,
                                                       static_cast<int>(row_starts_.size()) - 2));
  const float min_x = point.x - options_.max_disparity;
  int best = -1, best_distance = options_.max_distance;
  for (std::uint32_t i = row_starts_[row]; i < row_starts_[row + 1]; ++i) {
    const Feature& candidate = right.points[by_row_[i]];
    // A little to the right is allowed: positions are whole pixels before the refinement.
    if (candidate.x < min_x || candidate.x > point.x + 1) continue;
    if (std::abs(candidate.octave - point.octave) > options_.max_octave_difference) continue;
    const int distance = hamming_distance(descriptor, right.descriptors[by_row_[i]]);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = static_cast<int>(by_row_[i]);
  }
  return best;
}

void StereoMatcher::match(const Pyramid& left_images, const Pyramid& right_images,
                          const Features& right, Features& left) {
  sort_by_row(right_images, right);
  matched_.clear();
  for (std::size_t i = 0; i < left.size(); ++i) {
    Feature& point = left.points[i];
    point.disparity = 0;
    const int candidate = best_candidate(point, left.descriptors[i], right);
    if (candidate < 0) continue;
    const int level = point.octave;
    const cv::Point2f at = left_images.from_full(level, {point.x, point.y});
    const cv::Point2f start = right_images.from_full(
        level, {right.points[static_cast<std::size_t>(candidate)].x, point.y});
    const int xl = static_cast<int>(std::lround(at.x)), y = static_cast<int>(std::lround(at.y));
    const auto refined = slide(left_images[level], right_images[level], xl,
                               static_cast<int>(std::lround(start.x)), y);
    if (!refined) continue;
    const float disparity = (static_cast<float>(xl) - refined->x) * left_images.scale_x(level);
    if (disparity < options_.min_disparity || disparity > options_.max_disparity) continue;
    point.disparity = disparity;
    matched_.push_back({static_cast<std::uint32_t>(i), refined->difference});
  }
  drop_outliers(left);
}

void StereoMatcher::drop_outliers(Features& left) {
  if (matched_.empty()) return;
  const auto middle = matched_.begin() + static_cast<std::ptrdiff_t>(matched_.size() / 2);
  std::nth_element(matched_.begin(), middle, matched_.end(),
                   [](const Matched& a, const Matched& b) { return a.difference < b.difference; });
  const float limit = kOutlierFactor * static_cast<float>(middle->difference);
  for (const Matched& m : matched_)
    if (static_cast<float>(m.difference) > limit) left.points[m.feature].disparity = 0;
}

}  // namespace cairn
