// FAST corners with an adaptive threshold.
//
// Source: Rosten and Drummond 2006, FAST-9 on a circle of 16 pixels, with suppression of all but
// the strongest among neighbours.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "client/frontend/corner.h"
#include "client/frontend/kernels.h"

namespace cairn {

struct FastOptions {
  int high_threshold = 20;  // grey levels that the contrast must exceed
  int low_threshold = 7;    // used in cells where the high one finds nothing; 0: never
  // The low one on levels where the other leaves too few (EntropyOptions::min_threshold): where
  // little stands out, too little is found again in the next image without these corners.
  int fill_threshold = 4;
  // Corners below it are faint: at equal entropy of their surroundings they find their partner in
  // another view a third to a half as often as those above high_threshold.
  int faint_threshold = 10;
  int cell = 32;  // pixels a side
};

// The highest threshold at which (x, y) is a corner: the contrast with the centre that nine
// neighbouring pixels of the circle exceed; 0 where there is no such. (x, y)
// keeps 3 pixels from the edges of `image` (CV_8UC1).
int fast_score(const cv::Mat& image, int x, int y);

// Where between the pixels the corner at (x, y) lies: peak of the paraboloid through the scores of
// the 3 x 3 pixels around (least squares), less than half a pixel away along each axis. Lowers the
// distance between corresponding corners of warped photographs from 0.73 to 0.51 pixels
// (tests/bench/descriptor_report.cc). (x, y) keeps 5 pixels from the edges.
cv::Point2f subpixel_corner(const cv::Mat& image, int x, int y,
                            const Kernels& kernels = best_kernels());

// Used from one thread; keeps scratch memory between calls.
class FastDetector {
 public:
  explicit FastDetector(const FastOptions& options, const Kernels& kernels = best_kernels())
      : options_(options), kernels_(&kernels) {}

  // Replaces `corners` by those of `level` (CV_8UC1) that keep `border` pixels (at least 3) from
  // the edges: the strong ones row by row, then the weak ones cell by cell.
  void detect(const cv::Mat& level, int border, std::vector<Corner>& corners) {
    detect(level, border, options_.low_threshold, corners);
  }
  // The same with another low threshold.
  void detect(const cv::Mat& level, int border, int low_threshold, std::vector<Corner>& corners);

 private:
  void append(const cv::Mat& level, const cv::Rect& area, int threshold,
              std::vector<Corner>& corners);

  FastOptions options_;
  const Kernels* kernels_;
  std::vector<std::uint8_t> scores_;    // of three rows of the area being searched
  std::vector<std::uint16_t> peaks_;    // of one row
  std::vector<std::uint8_t> occupied_;  // per cell
};

}  // namespace cairn
