// Steered BRIEF (Rublee et al. 2011, section 4): binary tests between points of the smoothed patch
// around a corner, turned with the corner's orientation.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/brief_pattern.h"
#include "common/model/features.h"

namespace cairn {

// Gaussian blur, 7x7, sigma 2: tests compare regions, not noisy pixels. `out` has the size of `in`
// already; both CV_8UC1.
void smooth(const cv::Mat& in, cv::Mat& out);

// The pattern turned to every orientation, in steps fine enough that rounding to whole pixels
// outweighs them. Immutable; safe to use from several threads.
class Describer {
 public:
  explicit Describer(std::span<const BriefTest, kBriefTests> tests = kBriefPattern);

  // `smoothed` as by smooth(); (x, y) keeps kPatchBorder from its edges; `angle` in radians, any.
  Descriptor describe(const cv::Mat& smoothed, int x, int y, float angle) const;

 private:
  // For each angle: the 256 points a, then the 256 points b.
  std::vector<std::int16_t> x_, y_;
};

}  // namespace cairn
