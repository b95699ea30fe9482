#include "client/frontend/fast.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <gtest/gtest.h>
#include <opencv2/features2d.hpp>

#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

std::vector<Corner> detect(const cv::Mat& image, const FastOptions& options, int border = 3) {
  FastDetector detector(options);
  std::vector<Corner> corners;
  detector.detect(image, border, corners);
  return corners;
}

// OpenCV drops all of several equal neighbours, here one remains; and it counts the score from the
// highest threshold that is passed, one less than the contrast.
TEST(Fast, FindsOpenCvsCornersWithOneThreshold) {
  for (const cv::Size size : {cv::Size(200, 150), cv::Size(19, 90), cv::Size(37, 37)}) {
    const cv::Mat image = test::textured_image(size, 1, size.area() / 60);
    std::vector<cv::KeyPoint> expected;
    cv::FAST(image, expected, 20, true);
    EXPECT_FALSE(expected.empty());
    std::set<std::tuple<int, int, int>> found;
    for (const Corner& c : detect(image, {.high_threshold = 20, .low_threshold = 0}))
      EXPECT_TRUE(found.insert({c.x, c.y, c.score - 1}).second);
    for (const cv::KeyPoint& k : expected)
      EXPECT_EQ(found.erase({static_cast<int>(k.pt.x), static_cast<int>(k.pt.y),
                             static_cast<int>(k.response)}),
                1u);
    for (const auto& [x, y, score] : found) {  // what is left had an equal before it
      EXPECT_GT(score, 19);
      bool tie = false;
      for (int i = 0; i < 4; ++i) {
        const int u = x + (i < 3 ? i - 1 : -1), v = y - (i < 3 ? 1 : 0);
        if (u < 3 || v < 3 || u >= size.width - 3) continue;
        tie |= fast_score(image, u, v) == score + 1;
      }
      EXPECT_TRUE(tie) << x << ' ' << y;
    }
  }
}

// Worked by hand: a single pixel 60 above its surroundings has all 16 contrasts at -60.
TEST(Fast, ScoreIsTheContrastOfTheWeakestPixelOfTheBestArc) {
  cv::Mat image(9, 9, CV_8UC1, cv::Scalar(100));
  image.at<uchar>(4, 4) = 160;
  EXPECT_EQ(fast_score(image, 4, 4), 60);
  EXPECT_EQ(fast_score(cv::Mat(9, 9, CV_8UC1, cv::Scalar(100)), 4, 4), 0);
  image.at<uchar>(1, 4) = 140;  // the top of the circle: an arc of nine can do without it
  EXPECT_EQ(fast_score(image, 4, 4), 60);
  image.at<uchar>(7, 4) = 150;  // and the bottom: no arc of nine avoids both, the better one counts
  EXPECT_EQ(fast_score(image, 4, 4), 20);
}

TEST(Fast, TakesTheLowThresholdOnlyWhereTheHighOneFindsNothing) {
  cv::Mat image(128, 128, CV_8UC1, cv::Scalar(100));
  const auto dot = [&](int x, int y, int contrast) {
    image(cv::Rect(x, y, 2, 2)).setTo(100 + contrast);
  };
  dot(20, 20, 80);
  dot(30, 25, 12);   // weak, in the cell of a strong one
  dot(90, 100, 12);  // weak, alone
  const auto has = [](const std::vector<Corner>& corners, int x, int y) {
    return std::any_of(corners.begin(), corners.end(), [&](const Corner& c) {
      return std::abs(c.x - x) <= 2 && std::abs(c.y - y) <= 2;
    });
  };
  const auto corners = detect(image, {.high_threshold = 20, .low_threshold = 7, .cell = 32});
  EXPECT_TRUE(has(corners, 20, 20));
  EXPECT_FALSE(has(corners, 30, 25));
  EXPECT_TRUE(has(corners, 90, 100));
}

TEST(Fast, KeepsTheBorderAndCopesWithSmallImages) {
  for (const Corner& c : detect(test::textured_image({100, 80}, 2), {}, 19)) {
    EXPECT_GE(c.x, 19);
    EXPECT_GE(c.y, 19);
    EXPECT_LT(c.x, 81);
    EXPECT_LT(c.y, 61);
  }
  EXPECT_TRUE(detect(test::textured_image({38, 80}, 2), {}, 19).empty());
  EXPECT_TRUE(detect(cv::Mat(100, 100, CV_8UC1, cv::Scalar(3)), {}, 3).empty());
}

// A blurred spot moved by fractions of a pixel.
TEST(SubpixelCorner, FollowsASpotBetweenThePixels) {
  for (const double shift : {-0.4, -0.2, 0.0, 0.2, 0.4}) {
    cv::Mat image(21, 21, CV_8UC1);
    for (int y = 0; y < 21; ++y)
      for (int x = 0; x < 21; ++x)
        image.at<uchar>(y, x) = cv::saturate_cast<uchar>(
            50 + 180 * std::exp(-(std::pow(x - 10 - shift, 2) + std::pow(y - 10 + shift, 2)) / 6));
    const cv::Point2f found = subpixel_corner(image, 10, 10);
    EXPECT_NEAR(found.x, 10 + shift, 0.12);
    EXPECT_NEAR(found.y, 10 - shift, 0.12);
  }
}

}  // namespace
}  // namespace cairn
