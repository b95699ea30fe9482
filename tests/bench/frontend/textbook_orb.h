// The yardstick: ORB extraction as the ORB-SLAM2 paper (Mur-Artal and Tardos 2017, after ORB-SLAM,
// 2015, section III-C and Rublee et al. 2011) describes it, put together from OpenCV's functions
// the way that a textbook would. Nothing is sharpened.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include "common/model/features.h"

namespace cairn::bench {

struct TextbookOptions {
  int features = 1000;
  int levels = 8;
  double factor = 1.2;
  int high_threshold = 20, low_threshold = 7;
  int cell = 30;  // pixels
};

class TextbookOrb {
 public:
  explicit TextbookOrb(const TextbookOptions& options) : options_(options) {}
  void extract(const cv::Mat& gray, Features& out);

 private:
  std::vector<cv::KeyPoint> cell_corners(const cv::Mat& level) const;

  TextbookOptions options_;
  std::vector<cv::Mat> pyramid_;
};

}  // namespace cairn::bench
