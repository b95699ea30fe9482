#include "client/frontend/extractor.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "client/frontend/orient.h"
#include "client/frontend/sharpen.h"
#include "common/util/clock.h"

namespace cairn {
namespace {

// Shares of the features fall with the side length of the levels (not with their area: coarse
// levels see far motions and blur), so by 1 / factor from one to the next.
double share(const ScalePyramid& pyramid, int level) {
  const double q = 1.0 / pyramid.factor;
  return q < 1 ? std::pow(q, level) * (1 - q) / (1 - std::pow(q, pyramid.levels))
               : 1.0 / pyramid.levels;
}

}  // namespace

ExtractorOptions as_in_paper(ExtractorOptions options) {
  options.entropy.min_threshold = 0;
  options.flat_share = 1;
  options.best_first = false;
  options.describe_sharpened = true;
  return options;
}

Extractor::Extractor(const ExtractorOptions& options, const Kernels& kernels)
    : options_(options),
      kernels_(&kernels),
      pyramid_(options.pyramid, kernels),
      threshold_(options.entropy),
      fast_(options.fast, kernels),
      describer_(kBriefPattern, kernels) {}

void Extractor::extract(const cv::Mat& gray, Features& out) {
  out.points.clear();
  out.descriptors.clear();
  stats_ = {};
  if (gray.empty() || gray.type() != CV_8UC1) return;

  const Stopwatch total;
  pyramid_.build(gray);
  stats_.pyramid_ms = total.milliseconds();
  sharpened_.create(gray.size(), CV_8UC1);
  smoothed_.create(gray.size(), CV_8UC1);
  measure_entropy();
  double due = 0;
  int taken = 0;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    const cv::Mat image = sharpen_blocks(level);
    find_corners(image);
    // What one level cannot fill of its share the coarser ones may use.
    due += options_.features * share(options_.pyramid, level);
    choose_corners(level, static_cast<int>(std::lround(due)) - taken);
    taken += static_cast<int>(chosen_.size());
    emit(level, image, out);
  }
  stats_.total_ms = total.milliseconds();
}

void Extractor::measure_entropy() {
  low_threshold_ = options_.fast.low_threshold;
  if (options_.entropy.mode == EntropyMode::kOff) return;
  const Stopwatch watch;
  entropies_.clear();
  next_entropy_ = 0;
  for (int level = 0; level < pyramid_.levels(); ++level)
    append_block_entropies(pyramid_[level],
                           BlockGrid(pyramid_[level].size(), options_.entropy.block),
                           options_.entropy.variant, entropies_, *kernels_);
  stats_.blocks = static_cast<int>(entropies_.size());
  stats_.image_entropy = std::accumulate(entropies_.begin(), entropies_.end(), 0.0) / stats_.blocks;
  stats_.threshold = threshold_.next(stats_.image_entropy);
  const double in_flat = std::max(stats_.threshold, options_.entropy.least_in_flat_images());
  const auto weak =
      std::count_if(entropies_.begin(), entropies_.end(), [&](float e) { return e < in_flat; });
  if (static_cast<double>(weak) > options_.flat_share * stats_.blocks) {
    stats_.threshold = in_flat;
    low_threshold_ = std::min(low_threshold_, options_.fast.flat_threshold);
  }
  stats_.entropy_ms = watch.milliseconds();
}

// The level with its weak blocks sharpened: the level itself when there is none.
cv::Mat Extractor::sharpen_blocks(int level) {
  const cv::Mat& plain = pyramid_[level];
  if (options_.entropy.mode == EntropyMode::kOff) return plain;
  const Stopwatch watch;
  const BlockGrid grid(plain.size(), options_.entropy.block);
  sharpened_blocks_.assign(static_cast<std::size_t>(grid.size()), 0);
  cv::Mat image = plain;
  for (int i = 0; i < grid.size(); ++i) {
    if (entropies_[next_entropy_++] >= stats_.threshold) continue;
    sharpened_blocks_[static_cast<std::size_t>(i)] = 1;
    if (image.data == plain.data) {
      image = sharpened_(cv::Rect({}, plain.size()));
      plain.copyTo(image);
    }
    sharpen(plain, grid.area(i), image, *kernels_);
    ++stats_.blocks_sharpened;
  }
  stats_.sharpen_ms += watch.milliseconds();
  return image;
}

void Extractor::find_corners(const cv::Mat& image) {
  const Stopwatch watch;
  fast_.detect(image, kPatchBorder, low_threshold_, corners_);
  stats_.corners += static_cast<int>(corners_.size());
  stats_.fast_ms += watch.milliseconds();
}

void Extractor::choose_corners(int level, int wanted) {
  const Stopwatch watch;
  const cv::Size size = pyramid_[level].size();
  const cv::Rect area(kPatchBorder, kPatchBorder, size.width - 2 * kPatchBorder,
                      size.height - 2 * kPatchBorder);
  if (options_.best_first && options_.entropy.mode != EntropyMode::kOff)
    choose_best_first(level, area, wanted);
  else
    quadtree_.choose(corners_, area, wanted, chosen_);
  stats_.quadtree_ms += watch.milliseconds();
}

void Extractor::choose_best_first(int level, const cv::Rect& area, int wanted) {
  const BlockGrid grid(pyramid_[level].size(), options_.entropy.block);
  const auto sharpened = std::partition(corners_.begin(), corners_.end(), [&](const Corner& c) {
    return !sharpened_blocks_[static_cast<std::size_t>(grid.at(c.x, c.y))];
  });
  const auto strong = std::count_if(corners_.begin(), sharpened, [&](const Corner& c) {
    return c.score >= options_.fast.high_threshold;
  });
  auto best = sharpened;
  if (strong >= wanted)
    best = std::partition(corners_.begin(), sharpened, [&](const Corner& c) {
      return c.score >= options_.fast.faint_threshold;
    });
  quadtree_.choose({corners_.begin(), best}, area, wanted, chosen_);
  quadtree_.choose({sharpened, corners_.end()}, area, wanted - static_cast<int>(chosen_.size()),
                   more_);
  chosen_.insert(chosen_.end(), more_.begin(), more_.end());
}

void Extractor::emit(int level, const cv::Mat& image, Features& out) {
  if (chosen_.empty()) return;
  const cv::Mat& described = options_.describe_sharpened ? image : pyramid_[level];
  const std::size_t first = out.size();
  const Stopwatch orienting;
  for (const Corner& c : chosen_) {
    const cv::Point2f full = pyramid_.to_full(level, subpixel_corner(image, c.x, c.y, *kernels_));
    out.points.push_back({.x = full.x,
                          .y = full.y,
                          .angle = orientation(described, c.x, c.y, *kernels_),
                          .octave = static_cast<std::uint8_t>(level)});
  }
  stats_.orient_ms += orienting.milliseconds();

  const Stopwatch smoothing;
  cv::Mat smoothed = smoothed_(cv::Rect({}, image.size()));
  smooth(described, smoothed, blur_line_, *kernels_);
  stats_.smooth_ms += smoothing.milliseconds();

  const Stopwatch describing;
  for (std::size_t i = 0; i < chosen_.size(); ++i)
    out.descriptors.push_back(
        describer_.describe(smoothed, chosen_[i].x, chosen_[i].y, out.points[first + i].angle));
  stats_.describe_ms += describing.milliseconds();
}

}  // namespace cairn
