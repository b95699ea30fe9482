// Bilinear resize of grey images, one map for one pair of sizes.
//
// Weights have 7 bits across and 15 bits down, so a pixel may differ from the exact value by one
// grey level. Pixel centres are those of cv::resize: source = (target + 1/2) * scale - 1/2.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/kernels.h"

namespace cairn {

// Used from one thread; keeps scratch memory between calls.
class ResizeMap {
 public:
  ResizeMap(cv::Size from, cv::Size to);

  // Both are CV_8UC1 and of the sizes given; `out` must not overlap `in`.
  void apply(const cv::Mat& in, cv::Mat& out, const Kernels& kernels = best_kernels());

 private:
  struct Taps {  // of one pixel, along one axis: from + part
    int from;
    double part;
  };
  static Taps taps(int target, int from_size, int to_size);
  void make_columns(int from, int to);

  int width_ = 0;
  bool in_groups_ = true;
  std::vector<std::int32_t> from_, step_, group_;
  std::vector<std::uint8_t> weight_, shuffle_;
  std::vector<int> row_, row_step_, row_weight_;  // per target row; weight in 1/32768
  std::vector<std::int16_t> lines_[2];            // source rows after the first half
};

}  // namespace cairn
