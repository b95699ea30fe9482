#include "client/frontend/sharpen.h"

#include <algorithm>

#include <gtest/gtest.h>

#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

// Equation 8 word by word, with repeated border pixels.
cv::Mat naive(const cv::Mat& in) {
  cv::Mat out(in.size(), CV_8UC1);
  const auto at = [&](int y, int x) {
    return int{in.at<uchar>(std::clamp(y, 0, in.rows - 1), std::clamp(x, 0, in.cols - 1))};
  };
  for (int y = 0; y < in.rows; ++y)
    for (int x = 0; x < in.cols; ++x)
      out.at<uchar>(y, x) = static_cast<uchar>(std::clamp(
          5 * at(y, x) - at(y - 1, x) - at(y + 1, x) - at(y, x - 1) - at(y, x + 1), 0, 255));
  return out;
}

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(Sharpen, EqualsTheNaiveConvolution) {
  const cv::Mat in = test::noise_image({97, 61}, 1);
  cv::Mat out = in.clone();
  sharpen(in, {0, 0, in.cols, in.rows}, out);
  EXPECT_TRUE(equal(out, naive(in)));
}

TEST(Sharpen, BlockByBlockLeavesNoSeam) {
  const cv::Mat in = test::noise_image({130, 70}, 2);
  cv::Mat out = in.clone();
  for (int y = 0; y < in.rows; y += 33)
    for (int x = 0; x < in.cols; x += 17)
      sharpen(in, {x, y, std::min(17, in.cols - x), std::min(33, in.rows - y)}, out);
  EXPECT_TRUE(equal(out, naive(in)));
}

TEST(Sharpen, TouchesNothingOutsideTheBlock) {
  const cv::Mat in = test::noise_image({64, 64}, 3);
  const cv::Rect block(16, 24, 20, 11);
  cv::Mat out = in.clone();
  sharpen(in, block, out);
  EXPECT_TRUE(equal(out(block), naive(in)(block)));
  in(block).copyTo(out(block));
  EXPECT_TRUE(equal(out, in));
}

TEST(Sharpen, LeavesAFlatImageAndRaisesContrastOfAnEdge) {
  cv::Mat in(16, 16, CV_8UC1, cv::Scalar(100)), out = in.clone();
  sharpen(in, {0, 0, 16, 16}, out);
  EXPECT_TRUE(equal(out, in));
  in.colRange(8, 16).setTo(110);
  sharpen(in, {0, 0, 16, 16}, out);
  EXPECT_EQ(out.at<uchar>(5, 7), 90);
  EXPECT_EQ(out.at<uchar>(5, 8), 120);
}

}  // namespace
}  // namespace cairn
