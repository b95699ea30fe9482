#include "client/frontend/frontend.h"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "client/frontend/undistort_map.h"
#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

const std::array<double, 5> kTumDistortion = {0.2624, -0.9531, -0.0054, 0.0026, 1.1633};

CameraConfig camera(Sensor sensor, const std::array<double, 5>& distortion = {}) {
  CameraConfig config;
  config.sensor = sensor;
  config.camera = Camera(LensModel::kPinhole, 640, 480, {517.3, 516.5, 318.6, 255.3}, distortion);
  config.baseline_m = 0.11;
  return config;
}

// `disparity` and `right` as seen from the left image: left(x) == right(x - disparity).
cv::Mat shifted(const cv::Mat& left, double disparity) {
  const cv::Mat by = (cv::Mat_<double>(2, 3) << 1, 0, -disparity, 0, 1, 0);
  cv::Mat right;
  cv::warpAffine(left, right, by, left.size(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  return right;
}

TEST(UndistortMap, AgreesWithTheCameraToAHundredthOfAPixel) {
  const Camera cameras[] = {
      camera(Sensor::kMono, kTumDistortion).camera,
      Camera(LensModel::kPinhole, 752, 480, {458.654, 457.296, 367.215, 248.375},
             {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0}),
      Camera(LensModel::kFisheye, 512, 512, {190.978, 190.973, 254.932, 256.897},
             {0.0034, 0.0007, -0.0020, 0.0002, 0})};
  std::mt19937 rng(1);
  for (const Camera& c : cameras) {
    const UndistortMap map(c);
    std::uniform_real_distribution<float> x(-0.5f, static_cast<float>(c.width()) - 0.5f);
    std::uniform_real_distribution<float> y(-0.5f, static_cast<float>(c.height()) - 0.5f);
    int compared = 0;
    for (int i = 0; i < 2000; ++i) {
      const float u = x(rng), v = y(rng);
      const auto exact = c.undistort({u, v});
      const auto looked_up = map.undistort(u, v);
      if (!exact || !looked_up) continue;
      // Far off the axis of a fisheye the ideal plane is stretched without limit.
      const double stretch = (*exact - c.ideal(0).project({0, 0, 1})).norm();
      if (stretch > 800) continue;
      EXPECT_LT((*exact - looked_up->cast<double>()).norm(), 0.01) << u << ' ' << v;
      ++compared;
    }
    EXPECT_GT(compared, 1000);
  }
}

TEST(UndistortMap, GivesNothingOutsideTheImageOrTheLensModel) {
  const UndistortMap plain(camera(Sensor::kMono).camera);
  EXPECT_FALSE(plain.undistort(-1, 10));
  EXPECT_FALSE(plain.undistort(10, 480));
  EXPECT_FALSE(plain.undistort(std::nanf(""), 10));
  EXPECT_EQ(*plain.undistort(12.5f, 7.25f), Eigen::Vector2f(12.5f, 7.25f));
  // Equidistant, 100 pixels a radian: 300 pixels off the axis lies behind the camera.
  const UndistortMap fisheye(Camera(LensModel::kFisheye, 640, 480, {100, 100, 319.5, 239.5}, {}));
  EXPECT_FALSE(fisheye.undistort(619, 239));
  EXPECT_TRUE(fisheye.undistort(400, 239));
}

TEST(Frontend, DescribesTheRigThatFeaturesBelongTo) {
  const Rig rgbd = Frontend(camera(Sensor::kRgbd, kTumDistortion)).rig();
  EXPECT_EQ(rgbd.sensor, Sensor::kRgbd);
  EXPECT_DOUBLE_EQ(rgbd.camera.baseline, 1 / (rgbd.camera.fx * 0.02));
  EXPECT_DOUBLE_EQ(rgbd.max_depth, 3.0);
  EXPECT_DOUBLE_EQ(rgbd.camera.fx, 517.3);
  EXPECT_EQ(rgbd.pyramid.levels, 8);
  EXPECT_DOUBLE_EQ(Frontend(camera(Sensor::kStereo)).rig().camera.baseline, 0.11);
  EXPECT_DOUBLE_EQ(Frontend(camera(Sensor::kStereo)).rig().max_depth, 40 * 0.11);
  EXPECT_EQ(Frontend(camera(Sensor::kMono)).rig().camera.baseline, 0);
}

TEST(Frontend, UndistortsFeaturesAndKeepsDescriptorsInStep) {
  const CameraConfig config = camera(Sensor::kMono, kTumDistortion);
  Frontend frontend(config);
  const cv::Mat image = test::textured_image({640, 480}, 1);
  const ObservedFrame seen =
      frontend.process({.stamp_ns = 42, .gray = image, .right = {}, .depth = {}});
  EXPECT_EQ(seen.stamp_ns, 42);
  Features raw;
  Extractor({}).extract(image, raw);
  ASSERT_EQ(seen.features.size(), raw.size());
  EXPECT_EQ(seen.features.descriptors, raw.descriptors);
  for (std::size_t i = 0; i < raw.size(); ++i) {
    const auto exact = config.camera.undistort(raw.points[i].pixel());
    ASSERT_TRUE(exact);
    EXPECT_LT((*exact - seen.features.points[i].pixel()).norm(), 0.01);
    EXPECT_FALSE(seen.features.points[i].has_depth());
  }
}

// Depth differs from pixel to pixel: it must be read where the feature is seen, not where it lies
// after undistortion.
TEST(Frontend, ReadsDepthAtTheDistortedPixel) {
  const CameraConfig config = camera(Sensor::kRgbd, kTumDistortion);
  Frontend frontend(config);
  cv::Mat depth(480, 640, CV_32FC1);
  for (int y = 0; y < 480; ++y)
    for (int x = 0; x < 640; ++x)
      depth.at<float>(y, x) =
          x < 200 ? 0.0f : (x < 220 ? std::nanf("") : 1.0f + 0.001f * static_cast<float>(x + y));
  const cv::Mat image = test::textured_image({640, 480}, 1);
  const ObservedFrame seen = frontend.process({.gray = image, .right = {}, .depth = depth});
  Features raw;
  Extractor({}).extract(image, raw);
  ASSERT_EQ(seen.features.size(), raw.size());
  int with_depth = 0;
  for (std::size_t i = 0; i < raw.size(); ++i) {
    const Feature& f = seen.features.points[i];
    const long x = std::lround(raw.points[i].x), y = std::lround(raw.points[i].y);
    EXPECT_EQ(f.has_depth(), x >= 220);
    if (!f.has_depth()) continue;
    EXPECT_NEAR(frontend.rig().camera.depth(f.disparity), 1 + 0.001 * static_cast<double>(x + y),
                1e-4);
    ++with_depth;
  }
  EXPECT_GT(with_depth, 300);
}

TEST(Frontend, FindsSubpixelDisparityOfAShiftedPair) {
  const cv::Mat left = test::textured_image({640, 480}, 2);
  for (const double disparity : {3.0, 12.25, 30.6}) {
    Frontend frontend(camera(Sensor::kStereo));
    const ObservedFrame seen =
        frontend.process({.gray = left, .right = shifted(left, disparity), .depth = {}});
    std::vector<double> errors;
    for (const Feature& f : seen.features.points)
      if (f.has_depth()) errors.push_back(std::abs(f.disparity - disparity));
    ASSERT_GT(errors.size(), seen.features.size() / 2);
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[errors.size() / 2], 0.15) << disparity;
    EXPECT_LT(errors[errors.size() * 95 / 100], 0.8) << disparity;
  }
}

TEST(Frontend, GivesNoDisparityToWhatTheOtherImageDoesNotShow) {
  Frontend frontend(camera(Sensor::kStereo));
  const ObservedFrame seen = frontend.process({.gray = test::textured_image({640, 480}, 2),
                                               .right = test::textured_image({640, 480}, 77),
                                               .depth = {}});
  const auto matched = std::count_if(seen.features.points.begin(), seen.features.points.end(),
                                     [](const Feature& f) { return f.has_depth(); });
  EXPECT_LT(matched, static_cast<long>(seen.features.size()) / 20);
}

TEST(Frontend, LeavesDepthUnknownWhenTheSecondImageIsMissing) {
  const cv::Mat image = test::textured_image({320, 240}, 2);
  for (const Sensor sensor : {Sensor::kRgbd, Sensor::kStereo}) {
    Frontend frontend(camera(sensor));
    const ObservedFrame seen = frontend.process({.gray = image, .right = {}, .depth = {}});
    EXPECT_GT(seen.features.size(), 100u);
    for (const Feature& f : seen.features.points) EXPECT_FALSE(f.has_depth());
  }
}

TEST(Frontend, GivesTheSameOnOneAndTwoThreads) {
  const cv::Mat left = test::textured_image({640, 480}, 3);
  const Frame frame{.gray = left, .right = shifted(left, 9.5), .depth = {}};
  Frontend one(camera(Sensor::kStereo), {.threads = 1});
  Frontend two(camera(Sensor::kStereo), {.threads = 2});
  for (int i = 0; i < 2; ++i) {
    const Features a = one.process(frame).features, b = two.process(frame).features;
    ASSERT_EQ(a.size(), b.size());
    EXPECT_EQ(a.descriptors, b.descriptors);
    for (std::size_t j = 0; j < a.size(); ++j)
      EXPECT_EQ(a.points[j].disparity, b.points[j].disparity);
  }
}

}  // namespace
}  // namespace cairn
