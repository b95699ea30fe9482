#include "client/frontend/stereo_match.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

constexpr int kWindow = 5;  // 11 x 11 pixels
constexpr int kSide = 2 * kWindow + 1;
constexpr int kSlide = 5;          // pixels of the level to either side of the descriptor's match
constexpr float kMinSlope = 1.0f;  // grey levels^2 per pixel, mean over the window
constexpr int kMaxSteps = 6;
constexpr float kSmallStep = 0.01f;  // pixels of the level
// Differences of the windows, as a share of contrast, above which they show different things: of
// any pair, and times the median of this pair.
constexpr float kMaxDifference = 0.5f;
constexpr float kOutlierFactor = 4.0f, kAlwaysGood = 0.05f;

using Window = std::array<float, kSide * kSide>;

// A window of the level, horizontally interpolated, its mean taken off: the two cameras need not
// expose alike. Returns the sum of squares of what remains.
float cut_window(const cv::Mat& image, float x, int y, Window& window) {
  const int left = static_cast<int>(std::floor(x));
  const float b = x - static_cast<float>(left), a = 1 - b;
  float sum = 0;
  for (int v = 0; v < kSide; ++v) {
    const std::uint8_t* row = image.ptr<std::uint8_t>(y + v - kWindow) + left - kWindow;
    for (int u = 0; u < kSide; ++u) {
      const float value = a * row[u] + b * row[u + 1];
      window[static_cast<std::size_t>(v * kSide + u)] = value;
      sum += value;
    }
  }
  const float mean = sum / static_cast<float>(window.size());
  float squares = 0;
  for (float& value : window) {
    value -= mean;
    squares += value * value;
  }
  return squares;
}

// Sum of absolute differences of the two windows, brightness of the centres taken off.
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

// Best whole pixel of the right image within kSlide of xr; nothing where that is the last one
// tried.
std::optional<int> slide(const cv::Mat& left, const cv::Mat& right, int xl, int xr, int y) {
  int best = 0, least = std::numeric_limits<int>::max();
  for (int i = -kSlide; i <= kSlide; ++i) {
    const int difference = window_difference(left, right, xl, xr + i, y);
    if (difference >= least) continue;
    least = difference;
    best = i;
  }
  if (std::abs(best) == kSlide) return std::nullopt;
  return xr + best;
}

struct Refined {
  float x;           // pixels of the level
  float difference;  // sum of squares, as a share of the left window's contrast
};

// Gauss-Newton on the squared difference of the windows over a horizontal shift (Lucas and Kanade
// 1981). A parabola through sums of absolute differences, which have a kink at their minimum, is
// off by up to half a pixel where the texture is lopsided.
std::optional<Refined> refine(const cv::Mat& left, const cv::Mat& right, int xl, int xr, int y) {
  Window wanted, ahead, behind, seen;
  const float contrast = cut_window(left, static_cast<float>(xl), y, wanted);
  // Slope of the left window along the row stands for the right one's: the same at the solution.
  cut_window(left, static_cast<float>(xl + 1), y, ahead);
  cut_window(left, static_cast<float>(xl - 1), y, behind);
  float curvature = 0;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    ahead[i] = 0.5f * (ahead[i] - behind[i]);
    curvature += ahead[i] * ahead[i];
  }
  if (curvature < kMinSlope * static_cast<float>(wanted.size())) return std::nullopt;
  float x = static_cast<float>(xr);
  for (int i = 0;; ++i) {
    cut_window(right, x, y, seen);
    float gradient = 0, difference = 0;
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      const float d = wanted[k] - seen[k];
      gradient += d * ahead[k];
      difference += d * d;
    }
    const float step = gradient / curvature;
    if (i == kMaxSteps || std::abs(step) < kSmallStep) return Refined{x, difference / contrast};
    x += step;
    if (std::abs(x - static_cast<float>(xr)) > 1) return std::nullopt;
  }
}

// The windows, slid and interpolated, stay inside both images.
bool has_room(const cv::Mat& left, const cv::Mat& right, int xl, int xr, int y) {
  constexpr int kReach = kWindow + kSlide + 2;
  return y >= kWindow && y + kWindow < left.rows && y + kWindow < right.rows && xl > kWindow &&
         xl + kWindow + 2 < left.cols && xr >= kReach && xr + kReach < right.cols;
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
    const int guess = static_cast<int>(std::lround(start.x));
    if (!has_room(left_images[level], right_images[level], xl, guess, y)) continue;
    const auto xr = slide(left_images[level], right_images[level], xl, guess, y);
    if (!xr) continue;
    const auto refined = refine(left_images[level], right_images[level], xl, *xr, y);
    if (!refined || refined->difference > kMaxDifference) continue;
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
  const float limit = std::max(kAlwaysGood, kOutlierFactor * middle->difference);
  for (const Matched& m : matched_)
    if (m.difference > limit) left.points[m.feature].disparity = 0;
}

}  // namespace cairn
