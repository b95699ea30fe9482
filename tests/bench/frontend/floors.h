// How fast each stage could be at most on the machine at hand, from what it must do in any case:
// bytes that it must move, at the measured speed of a copy within the second-level cache, and
// operations, at the measured clock and the issue rates below. The greater of the two is the floor.
// Nobody reaches it; it tells where there is still something to gain.
#pragma once

#include <opencv2/core/types.hpp>

#include "client/frontend/extractor.h"

namespace cairn::bench {

// Per cycle, as on x86-64 cores with AVX2 from 2019 on.
inline constexpr double kVectorOpsPerCycle = 3;  // of 32 bytes each
inline constexpr double kLoadsPerCycle = 2;
inline constexpr double kStoresPerCycle = 1;

struct Machine {
  double hertz = 0;        // from a chain of additions that depend on each other
  double bytes_per_s = 0;  // read and written, copying 256 kB
};
Machine measure_machine();

struct Floors {  // milliseconds
  double pyramid, entropy, sharpen, fast, quadtree, orient, smooth, describe;
};
// `stats` and `features` of a typical image of that size.
Floors floors(const Machine& machine, cv::Size size, const ScalePyramid& pyramid,
              const ExtractorStats& stats, double features);

}  // namespace cairn::bench
