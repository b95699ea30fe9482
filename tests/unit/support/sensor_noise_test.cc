#include "tests/support/sensor_noise.h"

#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/image_statistics.h"

namespace cairn::synthetic {
namespace {

cv::Mat flat(double value, int width = 320, int height = 240) {
  return cv::Mat(height, width, CV_32F, cv::Scalar(value));
}

TEST(GrayNoise, GrowsWithBrightness) {
  const SensorNoise noise(1);
  for (const auto& [level, expected] : {std::pair{40.0, 0.53}, {200.0, 0.84}}) {
    cv::Scalar mean, deviation;
    cv::meanStdDev(noise.gray(flat(level), 3, 1), mean, deviation);
    EXPECT_NEAR(mean[0], level, 0.1);
    // Rounding to whole levels adds 1/12 to the variance.
    EXPECT_NEAR(deviation[0], std::sqrt(expected * expected + 1.0 / 12), 0.06);
  }
}

TEST(GrayNoise, NeighboursShareIt) {
  const SensorNoise noise(1, {.dark = 8, .bright = 8});
  cv::Mat image;
  noise.gray(flat(128), 1, 1).convertTo(image, CV_32F);
  image -= 128;
  const auto correlation = [&](int shift) {
    const cv::Mat a = image.colRange(0, image.cols - shift), b = image.colRange(shift, image.cols);
    return a.dot(b) / std::sqrt(a.dot(a) * b.dot(b));
  };
  EXPECT_NEAR(correlation(1), 2.0 / 3, 0.05);  // of [1 2 1]: 4/6
  EXPECT_NEAR(correlation(2), 1.0 / 6, 0.05);
  EXPECT_NEAR(correlation(4), 0.0, 0.05);
}

TEST(GrayNoise, ComesFromSeedAndKeyAlone) {
  const SensorNoise noise(1), same(1), other(2);
  const cv::Mat image = flat(128);
  const cv::Mat expected = noise.gray(image, 5, 1);
  EXPECT_EQ(cv::norm(expected, same.gray(image, 5, 3), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(expected, same.gray(image, 6, 1), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(expected, other.gray(image, 5, 1), cv::NORM_INF), 0);
}

TEST(GrayNoise, ClipsAtTheEndsOfTheScale) {
  const SensorNoise noise(1);
  EXPECT_LE(cv::norm(noise.gray(flat(-20), 1, 1), cv::NORM_INF), 0);
  double low = 0;
  cv::minMaxLoc(noise.gray(flat(400), 1, 1), &low);
  EXPECT_EQ(low, 255);
}

TEST(DepthNoise, SpreadFollowsTheKinectModel) {
  const SensorNoise noise(1);
  for (const double z : {1.0, 2.0, 4.0}) {
    const cv::Mat depth = noise.depth(flat(z), 525, 9, 1);
    cv::Scalar mean, deviation;
    cv::meanStdDev(depth, mean, deviation, depth > 0);
    const double model = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
    const double step = 0.125 * z * z / (525 * 0.075);  // of disparity, in depth
    EXPECT_NEAR(mean[0], z, 0.6 * step);
    EXPECT_GT(deviation[0], 0.2 * model);
    EXPECT_LT(deviation[0], std::sqrt(model * model + step * step));
    EXPECT_GT(cv::countNonZero(depth), 0.99 * static_cast<double>(depth.total()));
  }
}

TEST(DepthNoise, SeesNothingOutOfRange) {
  const SensorNoise noise(1);
  EXPECT_EQ(cv::countNonZero(noise.depth(flat(0.2), 525, 1, 1)), 0);
  EXPECT_EQ(cv::countNonZero(noise.depth(flat(9.0), 525, 1, 1)), 0);
  EXPECT_EQ(cv::countNonZero(noise.depth(flat(0.0), 525, 1, 1)), 0);
}

TEST(DepthNoise, LeavesAShadowBesideNearThings) {
  const SensorNoise noise(1);
  cv::Mat exact = flat(3.0);
  exact.colRange(100, 200).setTo(1.0);
  const cv::Mat depth = noise.depth(exact, 525, 1, 1);
  // Disparities 39.4 and 13.1: 26 columns left of the near thing see no projector light.
  const auto valid = [&](int first, int last) {
    return cv::countNonZero(depth.colRange(first, last)) / (240.0 * (last - first));
  };
  EXPECT_EQ(valid(76, 100), 0);
  EXPECT_GT(valid(20, 72), 0.99);
  EXPECT_GT(valid(102, 198), 0.99);
  EXPECT_GT(valid(202, 300), 0.99);
  EXPECT_EQ(valid(199, 201), 0);  // the border itself
}

TEST(DepthNoise, SeesNothingAtFlatAngles) {
  const SensorNoise noise(1);
  cv::Mat steep = flat(0), gentle = flat(0);
  for (int x = 0; x < steep.cols; ++x) {
    // A wall that runs away from the camera: 1/z is linear in x, z ~ 2 m in the middle.
    steep.col(x).setTo(1.0 / (0.5 - 10.0 * (x - 160) / 525 * 0.5));
    gentle.col(x).setTo(1.0 / (0.5 - 1.0 * (x - 160) / 525 * 0.5));
  }
  EXPECT_LT(cv::countNonZero(noise.depth(steep, 525, 1, 1).colRange(155, 165)), 240);
  EXPECT_GT(cv::countNonZero(noise.depth(gentle, 525, 1, 1).colRange(155, 165)), 2350);
}

TEST(BlockEntropy, CountsBits) {
  cv::Mat image(32, 64, CV_8U, cv::Scalar(7));
  for (int i = 0; i < 32 * 32; ++i) {
    image.at<unsigned char>(i / 32, 32 + i % 32) = static_cast<unsigned char>(i % 16);
  }
  const auto entropies = block_entropies(image);
  ASSERT_EQ(entropies.size(), 2u);
  EXPECT_NEAR(entropies[0], 0, 1e-12);
  EXPECT_NEAR(entropies[1], 4, 1e-12);
  EXPECT_EQ(percentile({3, 1, 2}, 0.5), 2);
}

}  // namespace
}  // namespace cairn::synthetic
