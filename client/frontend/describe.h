// Steered BRIEF (Rublee et al. 2011, section 4): binary tests between points of the smoothed patch
// around a corner, turned with the corner's orientation.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/brief_pattern.h"
#include "client/frontend/kernels.h"
#include "common/model/features.h"

namespace cairn {

// Gaussian blur, 7x7, sigma 2: tests compare regions, not noisy pixels. Beyond the border the image
// is mirrored, without repeating the border pixel. `out` has the size of `in` already and does not
// overlap it; both CV_8UC1. `scratch` is memory to be kept between calls.
void smooth(const cv::Mat& in, cv::Mat& out, std::vector<std::uint16_t>& scratch,
            const Kernels& kernels = best_kernels());
void smooth(const cv::Mat& in, cv::Mat& out);

// The pattern turned to every orientation, in steps fine enough that rounding to whole pixels
// outweighs them. Used from one thread: where the points lie in memory is worked out anew whenever
// an image comes whose rows are another distance apart (a millisecond or less).
class Describer {
 public:
  explicit Describer(std::span<const BriefTest, kBriefTests> tests = kBriefPattern,
                     const Kernels& kernels = best_kernels());

  // `smoothed` as by smooth(); (x, y) keeps kPatchBorder from its edges; `angle` in radians, any.
  Descriptor describe(const cv::Mat& smoothed, int x, int y, float angle);

 private:
  void place(std::ptrdiff_t stride);

  const Kernels* kernels_;
  // For each angle: the 256 points a, then the 256 points b.
  std::vector<std::int16_t> x_, y_;
  std::vector<std::int32_t> offsets_;  // y * stride + x
  std::ptrdiff_t stride_ = 0;          // bytes between rows
};

}  // namespace cairn
