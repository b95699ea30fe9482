// FAST corners with an adaptive threshold.
//
// Source: Rosten and Drummond 2006, FAST-9 on a circle of 16 pixels, with suppression of all but
// the strongest among neighbours.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "client/frontend/corner.h"

namespace cairn {

struct FastOptions {
  int high_threshold = 20;  // grey levels
  int low_threshold = 7;    // used in cells where the high one finds nothing; 0: never
  int cell = 32;            // pixels a side
};

// Used from one thread; keeps scratch memory between calls.
class FastDetector {
 public:
  explicit FastDetector(const FastOptions& options) : options_(options) {}

  // Replaces `corners` by those of `level` (CV_8UC1) that keep `border` pixels (at least 3) from
  // the edges: the strong ones row by row, then the weak ones cell by cell.
  void detect(const cv::Mat& level, int border, std::vector<Corner>& corners);

 private:
  void append(const cv::Mat& level, const cv::Rect& area, int threshold,
              std::vector<Corner>& corners);

  FastOptions options_;
  std::vector<cv::KeyPoint> found_;
  std::vector<std::uint8_t> occupied_;  // per cell
};

}  // namespace cairn
