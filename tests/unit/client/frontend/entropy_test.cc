#include "client/frontend/entropy.h"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

constexpr auto kHistogram = EntropyVariant::kHistogram;
constexpr auto kShares = EntropyVariant::kShares;

TEST(Entropy, OfAFlatBlockIsZero) {
  EXPECT_NEAR(entropy(cv::Mat(16, 16, CV_8UC1, cv::Scalar(77)), kHistogram), 0, 1e-5);
  EXPECT_EQ(entropy(cv::Mat(), kHistogram), 0);
}

// Worked by hand: levels 0, 1, 2, 3 with shares 1/2, 1/4, 1/8, 1/8:
// 1/2 * 1 + 1/4 * 2 + 1/8 * 3 + 1/8 * 3 = 1.75 bits.
TEST(Entropy, OfFourLevelsIsTheSumOfEquation9) {
  const cv::Mat block = (cv::Mat_<uchar>(2, 4) << 0, 0, 0, 0, 1, 1, 2, 3);
  EXPECT_NEAR(entropy(block, kHistogram), 1.75, 1e-6);
}

TEST(Entropy, OfAllLevelsAlikeIsEightBits) {
  cv::Mat block(64, 64, CV_8UC1);
  for (int i = 0; i < 64 * 64; ++i) block.data[i] = static_cast<uchar>(i);
  EXPECT_NEAR(entropy(block, kHistogram), 8, 1e-6);
}

TEST(Entropy, ReadsOnlyItsBlockAlsoWhenTheWidthIsOdd) {
  cv::Mat image = test::noise_image({40, 40}, 3);
  image(cv::Rect(3, 5, 13, 7)).setTo(9);
  EXPECT_NEAR(entropy(image(cv::Rect(3, 5, 13, 7)), kHistogram), 0, 1e-5);
}

TEST(Entropy, OfAFlatImageBeyondTheTableIsZero) {
  EXPECT_NEAR(entropy(cv::Mat(480, 640, CV_8UC1, cv::Scalar(5)), kHistogram), 0, 1e-9);
}

// Shares of 1, 1, 2, 4 in their sum 8: 1/8 * 3 + 1/8 * 3 + 1/4 * 2 + 1/2 * 1 = 1.75 bits.
TEST(Entropy, OfSharesWeighsPixelsByTheirGreyLevel) {
  const cv::Mat block = (cv::Mat_<uchar>(2, 3) << 1, 1, 2, 4, 0, 0);
  EXPECT_NEAR(entropy(block, kShares), 1.75, 1e-6);
  EXPECT_EQ(entropy(cv::Mat(4, 4, CV_8UC1, cv::Scalar(0)), kShares), 0);
  EXPECT_NEAR(entropy(cv::Mat(4, 4, CV_8UC1, cv::Scalar(50)), kShares), 4, 1e-6);
}

TEST(BlockGrid, CoversEveryPixelOnceWithBlocksOfAboutOneSize) {
  for (const cv::Size size : {cv::Size(640, 480), cv::Size(533, 401), cv::Size(50, 31)}) {
    const BlockGrid grid(size, 64);
    cv::Mat covered(size, CV_8UC1, cv::Scalar(0));
    for (int i = 0; i < grid.size(); ++i) {
      covered(grid.area(i)) += 1;
      EXPECT_LE(grid.area(i).width, 96);
      EXPECT_GE(grid.area(i).width, std::min(size.width, 42));
    }
    double least = 0, most = 0;
    cv::minMaxLoc(covered, &least, &most);
    EXPECT_EQ(least, 1);
    EXPECT_EQ(most, 1);
  }
}

TEST(BlockGrid, TellsWhichBlockAPixelLiesIn) {
  for (const cv::Size size : {cv::Size(640, 480), cv::Size(533, 401), cv::Size(50, 31)}) {
    const BlockGrid grid(size, 64);
    for (int i = 0; i < grid.size(); ++i) {
      const cv::Rect area = grid.area(i);
      for (int y = area.y; y < area.br().y; ++y)
        for (int x = area.x; x < area.br().x; ++x) ASSERT_EQ(grid.at(x, y), i) << x << ' ' << y;
    }
  }
}

TEST(BlockGrid, GivesEntropiesInItsOrder) {
  cv::Mat image = test::noise_image({128, 128}, 4);
  image(cv::Rect(64, 0, 64, 64)).setTo(0);
  std::vector<float> entropies;
  append_block_entropies(image, BlockGrid(image.size(), 64), kHistogram, entropies);
  ASSERT_EQ(entropies.size(), 4u);
  EXPECT_NEAR(entropies[1], 0, 1e-5);
  EXPECT_GT(entropies[2], 7.5f);
}

TEST(EntropyThreshold, IsHalfTheRunningMeanAndDeltaWhenOnline) {
  EntropyThreshold threshold({.mode = EntropyMode::kOnline, .delta = 0.3, .min_threshold = 0});
  EXPECT_DOUBLE_EQ(threshold.next(6.0), 3.3);
  EXPECT_DOUBLE_EQ(threshold.next(4.0), 2.8);  // mean 5
  EXPECT_DOUBLE_EQ(threshold.next(2.0), 2.3);  // mean 4
  EXPECT_DOUBLE_EQ(threshold.mean(), 4.0);
}

TEST(EntropyThreshold, StaysAtTheFirstPassWhenCalibrated) {
  EntropyThreshold threshold(
      {.mode = EntropyMode::kCalibrated, .delta = 0.3, .scene_mean = 5, .min_threshold = 0});
  EXPECT_DOUBLE_EQ(threshold.next(8), 2.8);
  EXPECT_DOUBLE_EQ(threshold.next(1), 2.8);
}

TEST(EntropyThreshold, FillsLevelsUpOnlyWhereTheSceneSetsIt) {
  const auto bound = [](EntropyMode mode) {
    return EntropyOptions{.mode = mode, .min_threshold = 3}.threshold_to_fill();
  };
  EXPECT_EQ(bound(EntropyMode::kOnline), 3);
  EXPECT_EQ(bound(EntropyMode::kCalibrated), 3);
  EXPECT_EQ(bound(EntropyMode::kFixed), 0);
  EXPECT_EQ(bound(EntropyMode::kOff), 0);
}

TEST(EntropyThreshold, IsAsGivenWhenFixedAndNothingWhenOff) {
  EXPECT_EQ(EntropyThreshold({.mode = EntropyMode::kFixed, .fixed_threshold = 3.5}).next(7), 3.5);
  EXPECT_EQ(EntropyThreshold({.mode = EntropyMode::kOff}).next(7), 0);
}

}  // namespace
}  // namespace cairn
