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
  occupied_.create(gray.size(), CV_8UC1);
  measure_entropy();
  double due = 0;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    // What one level cannot fill of its share the coarser ones may use.
    due += options_.features * share(options_.pyramid, level);
    const std::size_t first = out.size();
    const int wanted = static_cast<int>(std::lround(due)) - static_cast<int>(first);
    describe(level, find_features(level, wanted, out), first, out);
  }
  stats_.total_ms = total.milliseconds();
}

void Extractor::measure_entropy() {
  if (options_.entropy.mode == EntropyMode::kOff) return;
  const Stopwatch watch;
  entropies_.resize(static_cast<std::size_t>(pyramid_.levels()));
  double sum = 0;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    std::vector<float>& entropies = entropies_[static_cast<std::size_t>(level)];
    entropies.clear();
    append_block_entropies(pyramid_[level],
                           BlockGrid(pyramid_[level].size(), options_.entropy.block),
                           options_.entropy.variant, entropies, *kernels_);
    sum = std::accumulate(entropies.begin(), entropies.end(), sum);
    stats_.blocks += static_cast<int>(entropies.size());
  }
  stats_.image_entropy = sum / stats_.blocks;
  stats_.threshold = threshold_.next(stats_.image_entropy);
  stats_.entropy_ms = watch.milliseconds();
}

// Appends their positions. Returns the level, sharpened as for the search that came last.
cv::Mat Extractor::find_features(int level, int wanted, Features& out) {
  found_.clear();
  cv::Mat image = add_features(level, stats_.threshold, options_.fast.low_threshold, wanted, out);
  const int lacking = wanted - static_cast<int>(found_.size());
  const double filling = options_.entropy.threshold_to_fill();
  if (lacking > 0 && filling > 0)
    image = add_features(level, std::max(stats_.threshold, filling),
                         std::min(options_.fast.low_threshold, options_.fast.fill_threshold),
                         lacking, out);
  stats_.blocks_sharpened += static_cast<int>(
      std::count(sharpened_blocks_.begin(), sharpened_blocks_.end(), std::uint8_t{1}));
  return image;
}

// What the level shows beside the features it has when blocks below that entropy are sharpened.
cv::Mat Extractor::add_features(int level, double least_entropy, int low_threshold, int wanted,
                                Features& out) {
  const cv::Mat image = sharpen_blocks(level, least_entropy);
  const Stopwatch searching;
  fast_.detect(image, kPatchBorder, low_threshold, corners_);
  stats_.fast_ms += searching.milliseconds();
  const Stopwatch choosing;
  leave_out_found(image.size());
  stats_.corners += static_cast<int>(corners_.size());
  choose_corners(level, wanted);
  stats_.quadtree_ms += choosing.milliseconds();

  const Stopwatch placing;
  for (const Corner& c : chosen_) {
    const cv::Point2f full = pyramid_.to_full(level, subpixel_corner(image, c.x, c.y, *kernels_));
    out.points.push_back({.x = full.x, .y = full.y, .octave = static_cast<std::uint8_t>(level)});
  }
  stats_.orient_ms += placing.milliseconds();
  found_.insert(found_.end(), chosen_.begin(), chosen_.end());
  return image;
}

// Drops corners close to found ones: the same, moved a little where their block has been sharpened
// since.
void Extractor::leave_out_found(const cv::Size& size) {
  if (found_.empty()) return;
  cv::Mat occupied = occupied_(cv::Rect({}, size));
  occupied.setTo(0);
  constexpr int kRadius = 3;  // of FAST's circle, pixels
  for (const Corner& c : found_)
    occupied(cv::Rect(c.x - kRadius, c.y - kRadius, 2 * kRadius + 1, 2 * kRadius + 1)).setTo(1);
  std::erase_if(corners_, [&](const Corner& c) { return occupied.at<std::uint8_t>(c.y, c.x); });
}

// The level with its weak blocks sharpened: the level itself when there is none.
cv::Mat Extractor::sharpen_blocks(int level, double least_entropy) {
  const cv::Mat& plain = pyramid_[level];
  if (options_.entropy.mode == EntropyMode::kOff) return plain;
  const Stopwatch watch;
  const BlockGrid grid(plain.size(), options_.entropy.block);
  const std::vector<float>& entropies = entropies_[static_cast<std::size_t>(level)];
  sharpened_blocks_.assign(entropies.size(), 0);
  cv::Mat image = plain;
  for (int i = 0; i < grid.size(); ++i) {
    const auto block = static_cast<std::size_t>(i);
    if (entropies[block] >= least_entropy) continue;
    sharpened_blocks_[block] = 1;
    if (image.data == plain.data) {
      image = sharpened_(cv::Rect({}, plain.size()));
      plain.copyTo(image);
    }
    sharpen(plain, grid.area(i), image, *kernels_);
  }
  stats_.sharpen_ms += watch.milliseconds();
  return image;
}

void Extractor::choose_corners(int level, int wanted) {
  const cv::Size size = pyramid_[level].size();
  const cv::Rect area(kPatchBorder, kPatchBorder, size.width - 2 * kPatchBorder,
                      size.height - 2 * kPatchBorder);
  if (options_.best_first && options_.entropy.mode != EntropyMode::kOff)
    choose_best_first(level, area, wanted);
  else
    quadtree_.choose(corners_, area, wanted, chosen_);
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

// The features from `first` on, which are those of the level.
void Extractor::describe(int level, const cv::Mat& image, std::size_t first, Features& out) {
  if (found_.empty()) return;
  const cv::Mat& described = options_.describe_sharpened ? image : pyramid_[level];
  const Stopwatch orienting;
  for (std::size_t i = 0; i < found_.size(); ++i)
    out.points[first + i].angle = orientation(described, found_[i].x, found_[i].y, *kernels_);
  stats_.orient_ms += orienting.milliseconds();

  const Stopwatch smoothing;
  cv::Mat smoothed = smoothed_(cv::Rect({}, image.size()));
  smooth(described, smoothed, blur_line_, *kernels_);
  stats_.smooth_ms += smoothing.milliseconds();

  const Stopwatch describing;
  for (std::size_t i = 0; i < found_.size(); ++i)
    out.descriptors.push_back(
        describer_.describe(smoothed, found_[i].x, found_[i].y, out.points[first + i].angle));
  stats_.describe_ms += describing.milliseconds();
}

}  // namespace cairn
