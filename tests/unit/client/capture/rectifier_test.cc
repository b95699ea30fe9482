#include "client/capture/rectifier.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/support/renderer.h"
#include "tests/support/sensor_noise.h"
#include "tests/support/trajectory.h"

namespace cairn {
namespace {

constexpr int kWidth = 320, kHeight = 240;

CameraConfig raw_pair(LensModel lens) {
  const bool fisheye = lens == LensModel::kFisheye;
  const std::array<double, 5> left_distortion =
      fisheye ? std::array<double, 5>{-0.01, 0.02, -0.008, 0.001, 0}
              : std::array<double, 5>{-0.28, 0.07, 0.0002, 0.00002, 0};
  const std::array<double, 5> right_distortion =
      fisheye ? std::array<double, 5>{-0.012, 0.018, -0.007, 0.001, 0}
              : std::array<double, 5>{-0.27, 0.065, -0.0001, -0.00004, 0};
  CameraConfig config;
  config.sensor = Sensor::kStereo;
  config.camera = Camera(lens, kWidth, kHeight, {200, 201, 158, 122}, left_distortion);
  config.right = CameraConfig::RightCamera{
      Camera(lens, kWidth, kHeight, {203, 202, 162, 117}, right_distortion),
      Rigid3(so3_exp({0.02, -0.03, 0.015}), {0.11, 0.002, -0.003})};
  return config;
}

// How far the patch of `left` around (x, y) lies above or below its row in `right`, by the least
// sum of squared differences, to a fraction of a pixel. NaN when the best match is at the limit.
double row_offset(const cv::Mat& left, const cv::Mat& right, int x, int y) {
  constexpr int kRadius = 9, kSide = 2 * kRadius + 1, kMaxOffset = 4, kMaxDisparity = 60;
  const cv::Mat patch = left(cv::Rect(x - kRadius, y - kRadius, kSide, kSide));
  const int first = std::max(0, x - kRadius - kMaxDisparity);
  const cv::Rect area(first, y - kRadius - kMaxOffset, x + kRadius + 1 - first,
                      kSide + 2 * kMaxOffset);
  cv::Mat cost;
  cv::matchTemplate(right(area), patch, cost, cv::TM_SQDIFF);
  cv::Point best;
  cv::minMaxLoc(cost, nullptr, nullptr, &best);
  if (best.y == 0 || best.y == cost.rows - 1) return std::nan("");
  const double above = cost.at<float>(best.y - 1, best.x), here = cost.at<float>(best);
  const double below = cost.at<float>(best.y + 1, best.x);
  return best.y - kMaxOffset + 0.5 * (above - below) / (above - 2 * here + below);
}

// Renders the raw pair before a wall and measures the rows of the rectified one.
std::vector<double> row_offsets(const CameraConfig& raw, const Rectifier& rectifier) {
  const auto scene = synthetic::make_scene("hall", 1);
  const Rigid3 left_pose = synthetic::Trajectory::make("hall", 0, 1)->world_from_camera(1);
  const auto image = [&](const Camera& camera, const Rigid3& pose) {
    return synthetic::quantised(synthetic::Renderer(*scene, camera, 1).render(pose).radiance);
  };
  const cv::Mat left = rectifier.left(image(raw.camera, left_pose));
  const cv::Mat right =
      rectifier.right(image(raw.right->camera, left_pose * raw.right->left_from_right));
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(left, corners, 80, 0.02, 15);
  std::vector<double> offsets;
  for (const cv::Point2f& corner : corners) {
    const int x = cvRound(corner.x), y = cvRound(corner.y);
    if (x < 60 || y < 16 || x >= kWidth - 16 || y >= kHeight - 16) continue;
    const double offset = row_offset(left, right, x, y);
    if (!std::isnan(offset)) offsets.push_back(std::abs(offset));
  }
  return offsets;
}

class Lenses : public testing::TestWithParam<LensModel> {};

TEST_P(Lenses, BringsWhatBelongsTogetherToTheSameRow) {
  const CameraConfig raw = raw_pair(GetParam());
  const auto rectifier = Rectifier::make(raw);
  ASSERT_TRUE(rectifier.ok()) << rectifier.message();
  std::vector<double> offsets = row_offsets(raw, *rectifier);
  ASSERT_GT(offsets.size(), 20u);
  std::sort(offsets.begin(), offsets.end());
  EXPECT_LT(offsets[offsets.size() / 2], 0.15);
  EXPECT_LT(offsets[offsets.size() * 9 / 10], 0.3);
}

TEST_P(Lenses, GivesAnIdealCameraWithTheDistanceOfTheTwo) {
  const CameraConfig raw = raw_pair(GetParam());
  const auto rectifier = Rectifier::make(raw);
  ASSERT_TRUE(rectifier.ok()) << rectifier.message();
  const CameraConfig& ideal = rectifier->camera();
  EXPECT_FALSE(ideal.camera.has_distortion());
  EXPECT_EQ(ideal.camera.lens(), LensModel::kPinhole);
  EXPECT_FALSE(ideal.right.has_value());
  EXPECT_EQ(ideal.camera.width(), kWidth);
  EXPECT_NEAR(ideal.baseline_m, raw.right->left_from_right.translation.norm(), 1e-6);
  EXPECT_NEAR(ideal.camera.intrinsics()[0], ideal.camera.intrinsics()[1], 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Models, Lenses, testing::Values(LensModel::kPinhole, LensModel::kFisheye));

TEST(Rectifier, RefusesPairsThatAreNone) {
  CameraConfig mixed = raw_pair(LensModel::kPinhole);
  mixed.right->camera = raw_pair(LensModel::kFisheye).right->camera;
  EXPECT_FALSE(Rectifier::make(mixed).ok());
  CameraConfig sizes = raw_pair(LensModel::kPinhole);
  sizes.right->camera = Camera(LensModel::kPinhole, 640, 480, {400, 400, 320, 240}, {});
  EXPECT_FALSE(Rectifier::make(sizes).ok());
  CameraConfig swapped = raw_pair(LensModel::kPinhole);
  swapped.right->left_from_right = swapped.right->left_from_right.inverse();
  const auto result = Rectifier::make(swapped);
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.message().find("left_from_right"), std::string::npos);
}

}  // namespace
}  // namespace cairn
