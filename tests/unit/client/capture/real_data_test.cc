// The sources on real recordings, where they are at hand: CAIRN_DATA, or ../shared/data beside the
// source tree.
#include <cstdlib>
#include <filesystem>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "client/capture/frame_source.h"

namespace cairn {
namespace {

std::filesystem::path data(const std::string& name) {
  const char* given = std::getenv("CAIRN_DATA");
  const std::filesystem::path root =
      given ? given : std::filesystem::path(CAIRN_SOURCE_DIR) / "../shared/data";
  return root / name;
}

// The first frame, and how the source describes itself.
struct First {
  Frame frame;
  CameraConfig camera;
  std::uint64_t size = 0;
};

First open_first(const std::string& spec, const std::optional<CameraConfig>& config) {
  auto source = open_source(spec, config);
  if (!source) {
    ADD_FAILURE() << source.message();
    return {};
  }
  auto frame = (*source)->next();
  if (!frame || !frame->has_value()) {
    ADD_FAILURE() << "no frame";
    return {};
  }
  return {**frame, (*source)->camera(), (*source)->size().value_or(0)};
}

TEST(RealData, TumRgbd) {
  const auto folder = data("tum_fr1_rpy_240");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  CameraConfig config;
  config.camera = Camera(LensModel::kPinhole, 640, 480, {517.306, 516.469, 318.643, 255.314},
                         {0.262383, -0.953104, -0.005358, 0.002628, 1.163314});
  const First first = open_first("tum:" + folder.string(), config);
  EXPECT_EQ(first.size, 240u);
  EXPECT_EQ(first.frame.stamp_ns, 1305031229528748000);
  double nearest = 0, farthest = 0;
  cv::minMaxLoc(first.frame.depth, &nearest, &farthest, nullptr, nullptr, first.frame.depth > 0);
  EXPECT_GT(nearest, 0.3);
  EXPECT_LT(farthest, 11);
}

TEST(RealData, EurocStereo) {
  const auto folder = data("euroc_v101_stereo_rest_20");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const First first = open_first("euroc:" + folder.string(), std::nullopt);
  EXPECT_EQ(first.size, 20u);
  EXPECT_EQ(first.camera.sensor, Sensor::kStereo);
  EXPECT_NEAR(first.camera.baseline_m, 0.1101, 0.0005);
  EXPECT_FALSE(first.camera.camera.has_distortion());
  EXPECT_EQ(first.frame.right.size(), cv::Size(752, 480));
}

TEST(RealData, EurocMono) {
  const auto folder = data("euroc_v101_mono_90");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const First first = open_first("euroc:" + folder.string(), std::nullopt);
  EXPECT_EQ(first.size, 90u);
  EXPECT_EQ(first.camera.sensor, Sensor::kMono);
  EXPECT_NEAR(first.camera.camera.distortion()[0], -0.28340811, 1e-9);
}

TEST(RealData, KittiStereo) {
  const auto folder = data("kitti_00_stereo_21");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  const First first = open_first("kitti:" + folder.string(), std::nullopt);
  EXPECT_EQ(first.size, 21u);
  EXPECT_NEAR(first.camera.baseline_m, 0.5372, 0.0001);
  EXPECT_EQ(first.frame.right.size(), first.frame.gray.size());
}

}  // namespace
}  // namespace cairn
