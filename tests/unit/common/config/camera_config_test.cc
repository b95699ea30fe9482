#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/config/camera_config_reader.h"

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr const char* kResolution = "  resolution: [640, 480]\n";
constexpr const char* kIntrinsics = "  intrinsics: [517.3, 516.5, 318.6, 255.3]\n";
// The right camera stands 0.1 m to the right of the left one and looks the same way.
constexpr const char* kRight =
    "  right:\n"
    "    resolution: [640, 480]\n"
    "    intrinsics: [500, 501, 320, 240]\n"
    "    left_from_right: [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n";

Result<CameraConfig> read(const std::string& text) {
  auto root = parse_yaml(text, "c.yaml");
  if (!root) return root.error();
  auto config = read_camera_config(*root);
  if (const Status done = root->finish(); !done) return done.error();
  return config;
}
Result<CameraConfig> read_keys(const std::string& camera_keys, const std::string& sensor = "rgbd") {
  return read("sensor: " + sensor + "\ncamera:\n" + kResolution + kIntrinsics + camera_keys);
}
std::string error_of(const Result<CameraConfig>& result) {
  return result.ok() ? "no error" : result.message();
}

TEST(CameraConfig, TwoKeysAreEnough) {
  const auto config = read(std::string("camera:\n") + kResolution + kIntrinsics);
  ASSERT_TRUE(config.ok()) << config.message();
  EXPECT_EQ(config->sensor, Sensor::kRgbd);
  EXPECT_EQ(config->camera.lens(), LensModel::kPinhole);
  EXPECT_EQ(config->camera.width(), 640);
  EXPECT_EQ(config->camera.height(), 480);
  EXPECT_THAT(config->camera.intrinsics(), ElementsAre(517.3, 516.5, 318.6, 255.3));
  EXPECT_FALSE(config->camera.has_distortion());
  EXPECT_EQ(config->rate_hz, 30);
  EXPECT_EQ(config->depth_scale, 5000);
  EXPECT_FALSE(config->right.has_value());
}

TEST(CameraConfig, ReadsEveryKey) {
  const auto config = read_keys(
      "  model: fisheye\n  distortion: [0.1, 0.2, 0.3, 0.4]\n  rate_hz: 20\n  depth_scale: 1000\n");
  ASSERT_TRUE(config.ok()) << config.message();
  EXPECT_EQ(config->camera.lens(), LensModel::kFisheye);
  EXPECT_THAT(config->camera.distortion(), ElementsAre(0.1, 0.2, 0.3, 0.4, 0));
  EXPECT_EQ(config->rate_hz, 20);
  EXPECT_EQ(config->depth_scale, 1000);
}

TEST(CameraConfig, RadialTangentialTakesNoneFourOrFiveCoefficients) {
  EXPECT_TRUE(read_keys("  distortion: []\n").ok());
  EXPECT_TRUE(read_keys("  distortion: [-0.28, 0.07, 0.0002, 0.00002]\n").ok());
  EXPECT_TRUE(read_keys("  distortion: [0.26, -0.95, -0.005, 0.003, 1.16]\n").ok());
  EXPECT_THAT(error_of(read_keys("  distortion: [0.1, 0.2]\n")), HasSubstr("has 2"));
  EXPECT_FALSE(read_keys("  distortion: [1, 2, 3, 4, 5, 6]\n").ok());
  EXPECT_FALSE(read_keys("  model: fisheye\n  distortion: [1, 2, 3, 4, 5]\n").ok());
}

TEST(CameraConfig, NotANumberInIntrinsicsIsNamed) {
  EXPECT_EQ(error_of(read("camera:\n  resolution: [640, 480]\n  intrinsics: [.nan, 1, 2, 3]\n")),
            "c.yaml:3: camera.intrinsics: number 1 of (fx fy cx cy) is not a finite number: .nan");
}

TEST(CameraConfig, ImpossibleCamerasAreRefused) {
  const auto intrinsics = [](const std::string& numbers) {
    return error_of(read("camera:\n  resolution: [640, 480]\n  intrinsics: [" + numbers + "]\n"));
  };
  EXPECT_THAT(intrinsics("0, 500, 320, 240"), HasSubstr("greater than 0"));
  EXPECT_THAT(intrinsics("500, -500, 320, 240"), HasSubstr("greater than 0"));
  EXPECT_THAT(intrinsics("500, 500, 3200, 240"), HasSubstr("far outside the image"));
  const auto resolution = [](const std::string& numbers) {
    return read("camera:\n  resolution: [" + numbers + "]\n" + kIntrinsics).ok();
  };
  EXPECT_FALSE(resolution("15, 480"));
  EXPECT_FALSE(resolution("640, 16385"));
  EXPECT_FALSE(resolution("640.5, 480"));
  EXPECT_FALSE(resolution("640"));
}

TEST(CameraConfig, RatesAndScalesMustBePositive) {
  EXPECT_FALSE(read_keys("  rate_hz: 0\n").ok());
  EXPECT_FALSE(read_keys("  depth_scale: 0\n").ok());
  EXPECT_FALSE(read_keys("  baseline_m: -0.1\n", "stereo").ok());
}

TEST(CameraConfig, UnknownKeysAreNamed) {
  EXPECT_EQ(error_of(read_keys("  depth_scal: 1000\n")),
            "c.yaml:5: camera.depth_scal: unknown key; did you mean 'depth_scale'?");
  EXPECT_THAT(error_of(read_keys("", "lidar")), HasSubstr("must be one of rgbd, stereo, mono"));
}

TEST(CameraConfig, StereoNeedsABaselineOrASecondCamera) {
  EXPECT_THAT(error_of(read_keys("", "stereo")), HasSubstr("stereo needs either"));
  EXPECT_TRUE(read_keys("  baseline_m: 0.11\n", "stereo").ok());
  EXPECT_THAT(error_of(read_keys("  baseline_m: 0.11\n" + std::string(kRight), "stereo")),
              HasSubstr("stereo needs either"));
  EXPECT_THAT(error_of(read_keys("  baseline_m: 0.1\n  distortion: [0.1, 0, 0, 0]\n", "stereo")),
              HasSubstr("rectified"));
}

TEST(CameraConfig, ReadsTheRightCameraAndItsPlace) {
  const auto config = read_keys(kRight, "stereo");
  ASSERT_TRUE(config.ok()) << config.message();
  ASSERT_TRUE(config->right.has_value());
  EXPECT_EQ(config->right->camera.intrinsics()[0], 500);
  EXPECT_TRUE(config->right->left_from_right.translation.isApprox(Eigen::Vector3d(0.1, 0, 0)));
  EXPECT_NEAR(rotation_angle(config->right->left_from_right), 0, 1e-12);
}

TEST(CameraConfig, PlaceOfTheRightCameraMustBeARigidTransform) {
  const auto with = [](const std::string& matrix) {
    return error_of(
        read_keys("  right:\n    resolution: [640, 480]\n    intrinsics: [500, 501, 320, "
                  "240]\n    left_from_right: [" +
                      matrix + "]\n",
                  "stereo"));
  };
  EXPECT_THAT(with("2,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1"), HasSubstr("is no rotation"));
  EXPECT_THAT(with("1,0,0,0.1, 0,1,0,0, 0,0,-1,0, 0,0,0,1"), HasSubstr("is no rotation"));
  EXPECT_THAT(with("1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,1,1"), HasSubstr("last row"));
  EXPECT_THAT(with("1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1"), HasSubstr("metres apart"));
  EXPECT_THAT(with("1,0,0,0.1, 0,1,0,0, 0,0,1,0"), HasSubstr("needs 16 numbers"));
}

TEST(CameraConfig, SensorAloneCanBeRead) {
  auto root = parse_yaml("sensor: mono\n", "c.yaml");
  ASSERT_TRUE(root.ok());
  EXPECT_EQ(read_sensor(*root), Sensor::kMono);
  EXPECT_TRUE(root->finish().ok());
  auto empty = parse_yaml("", "c.yaml");
  EXPECT_EQ(read_sensor(*empty), std::nullopt);
}

}  // namespace
}  // namespace cairn
