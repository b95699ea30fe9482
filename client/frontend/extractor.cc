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

Extractor::Extractor(const ExtractorOptions& options)
    : options_(options),
      pyramid_(options.pyramid),
      threshold_(options.entropy),
      fast_(options.fast),
      corners_(options.pyramid.levels),
      chosen_(options.pyramid.levels) {}

void Extractor::extract(const cv::Mat& gray, Features& out) {
  out.points.clear();
  out.descriptors.clear();
  stats_ = {};
  if (gray.empty() || gray.type() != CV_8UC1) return;

  const Stopwatch total;
  pyramid_.build(gray);
  stats_.pyramid_ms = total.milliseconds();
  sharpened_.reshape(pyramid_.sizes());
  smoothed_.reshape(pyramid_.sizes());
  measure_entropy();
  sharpen_blocks();
  find_corners();
  choose_corners();
  emit(out);
  stats_.total_ms = total.milliseconds();
}

void Extractor::measure_entropy() {
  if (options_.entropy.mode == EntropyMode::kOff) return;
  const Stopwatch watch;
  entropies_.clear();
  for (int level = 0; level < pyramid_.levels(); ++level)
    append_block_entropies(pyramid_[level],
                           BlockGrid(pyramid_[level].size(), options_.entropy.block),
                           options_.entropy.variant, entropies_);
  stats_.blocks = static_cast<int>(entropies_.size());
  stats_.image_entropy = std::accumulate(entropies_.begin(), entropies_.end(), 0.0) / stats_.blocks;
  stats_.threshold = threshold_.next(stats_.image_entropy);
  stats_.entropy_ms = watch.milliseconds();
}

void Extractor::sharpen_blocks() {
  has_sharpened_.assign(static_cast<std::size_t>(pyramid_.levels()), false);
  if (options_.entropy.mode == EntropyMode::kOff) return;
  const Stopwatch watch;
  std::size_t next = 0;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    const BlockGrid grid(pyramid_[level].size(), options_.entropy.block);
    for (int i = 0; i < grid.size(); ++i) {
      if (entropies_[next++] >= stats_.threshold) continue;
      if (!has_sharpened_[static_cast<std::size_t>(level)]) {
        pyramid_[level].copyTo(sharpened_[level]);
        has_sharpened_[static_cast<std::size_t>(level)] = true;
      }
      sharpen(pyramid_[level], grid.area(i), sharpened_[level]);
      ++stats_.blocks_sharpened;
    }
  }
  stats_.sharpen_ms = watch.milliseconds();
}

const cv::Mat& Extractor::sharpened_or_plain(int level) const {
  return has_sharpened_[static_cast<std::size_t>(level)] ? sharpened_[level] : pyramid_[level];
}

void Extractor::find_corners() {
  const Stopwatch watch;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    auto& corners = corners_[static_cast<std::size_t>(level)];
    fast_.detect(sharpened_or_plain(level), kPatchBorder, corners);
    stats_.corners += static_cast<int>(corners.size());
  }
  stats_.fast_ms = watch.milliseconds();
}

// What one level cannot fill of its share the coarser ones may use.
void Extractor::choose_corners() {
  const Stopwatch watch;
  double due = 0;
  int taken = 0;
  for (int level = 0; level < pyramid_.levels(); ++level) {
    due += options_.features * share(options_.pyramid, level);
    const cv::Size size = pyramid_[level].size();
    const cv::Rect area(kPatchBorder, kPatchBorder, size.width - 2 * kPatchBorder,
                        size.height - 2 * kPatchBorder);
    auto& chosen = chosen_[static_cast<std::size_t>(level)];
    quadtree_.choose(corners_[static_cast<std::size_t>(level)], area,
                     static_cast<int>(std::lround(due)) - taken, chosen);
    taken += static_cast<int>(chosen.size());
  }
  stats_.quadtree_ms = watch.milliseconds();
}

void Extractor::emit(Features& out) {
  for (int level = 0; level < pyramid_.levels(); ++level) {
    const auto& chosen = chosen_[static_cast<std::size_t>(level)];
    if (chosen.empty()) continue;
    const cv::Mat& image = sharpened_or_plain(level);
    const std::size_t first = out.size();

    const Stopwatch orienting;
    for (const Corner& c : chosen) {
      const cv::Point2f full = pyramid_.to_full(level, subpixel_corner(image, c.x, c.y));
      out.points.push_back({.x = full.x,
                            .y = full.y,
                            .angle = orientation(image, c.x, c.y),
                            .octave = static_cast<std::uint8_t>(level)});
    }
    stats_.orient_ms += orienting.milliseconds();

    const Stopwatch smoothing;
    smooth(options_.describe_sharpened ? image : pyramid_[level], smoothed_[level]);
    stats_.smooth_ms += smoothing.milliseconds();

    const Stopwatch describing;
    for (std::size_t i = 0; i < chosen.size(); ++i)
      out.descriptors.push_back(describer_.describe(smoothed_[level], chosen[i].x, chosen[i].y,
                                                    out.points[first + i].angle));
    stats_.describe_ms += describing.milliseconds();
  }
}

}  // namespace cairn
