#include "tests/bench/frontend/floors.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "common/util/clock.h"

namespace cairn::bench {
namespace {

// The best of several tries: what the machine can do when nothing else runs.
template <typename Work>
double best_seconds(Work&& work) {
  double best = 1e9;
  for (int i = 0; i < 30; ++i) {
    const Stopwatch watch;
    work();
    best = std::min(best, watch.milliseconds() / 1000);
  }
  return best;
}

}  // namespace

Machine measure_machine() {
  constexpr int kAdditions = 2'000'000;
  const double chain = best_seconds([] {
    std::uint64_t x = 1;
    for (int i = 0; i < kAdditions; ++i) {
      x += 3;
      asm volatile("" : "+r"(x));  // each addition by itself
    }
  });
  std::vector<std::uint8_t> from(128 * 1024, 1), to(128 * 1024);
  constexpr int kCopies = 50;
  const double copy = best_seconds([&] {
    for (int i = 0; i < kCopies; ++i) {
      std::memcpy(to.data(), from.data(), from.size());
      asm volatile("" : : "r"(to.data()) : "memory");
    }
  });
  return {.hertz = kAdditions / chain,
          .bytes_per_s = 2.0 * kCopies * static_cast<double>(from.size()) / copy};
}

Floors floors(const Machine& machine, cv::Size size, const ScalePyramid& pyramid,
              const ExtractorStats& stats, double features) {
  double pixels = 0, coarser = 0;
  for (int level = 0; level < pyramid.levels; ++level) {
    const double scale = pyramid.scale(level);
    pixels += size.area() / (scale * scale);
    if (level > 0) coarser += size.area() / (scale * scale);
  }
  const double finest = size.area();
  const auto moved = [&](double bytes) { return 1e3 * bytes / machine.bytes_per_s; };
  const auto cycles = [&](double n) { return 1e3 * n / machine.hertz; };
  const auto vectors = [&](double px, double each) {
    return cycles(px / 32 * each / kVectorOpsPerCycle);
  };
  const double sharpened = stats.blocks > 0 ? pixels * stats.blocks_sharpened / stats.blocks : 0;
  return {
      // Level 0 copied, every other level written once and its source read once.
      .pyramid = moved(2 * finest + (pixels - coarser / 8) + coarser),
      // A count to be stored for each pixel.
      .entropy = cycles(pixels / kStoresPerCycle),
      .sharpen = moved(2 * sharpened),
      // Nine loads and 19 operations decide for 32 pixels that none is a corner.
      .fast = std::max(moved(pixels),
                       std::max(vectors(pixels, 19), cycles(pixels / 32 * 9 / kLoadsPerCycle))),
      // Every corner goes down to its cell: two comparisons a step.
      .quadtree = cycles(2 * stats.corners * std::log(std::max(4.0, features / pyramid.levels)) /
                         std::log(4.0)),
      // 31 rows of 32 bytes: widen, mask, add, subtract, weigh, add twice.
      .orient = cycles(features * 31 * 2 * 3.5 / kVectorOpsPerCycle),
      // Separable, symmetric, in 16 bits (two vectors for 32 pixels): per direction 3 additions of
      // equals, 4 products, 4 sums.
      .smooth = std::max(moved(2 * pixels), vectors(pixels, 2 * 2 * 11)),
      // 512 pixels and where they are.
      .describe = cycles(features * 1024 / kLoadsPerCycle),
  };
}

}  // namespace cairn::bench
