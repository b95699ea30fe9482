#include "tests/support/renderer.h"

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/support/scene_builder.h"
#include "tests/support/trajectory.h"

namespace cairn::synthetic {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

Camera small_pinhole() {
  return Camera(LensModel::kPinhole, 160, 120, {130, 130, 79.5, 59.5}, {});
}

// A grey wall at y = 2, facing the origin, with one white square of 6 cm at (x, z).
std::shared_ptr<const Scene> wall_with_mark(double x, double z) {
  SceneBuilder builder("wall", 1);
  const auto plain = [](double level) {
    return [level](Random&, const paint::Area& area) {
      return cv::Mat(area.rows(), area.columns(), CV_32F, cv::Scalar(level));
    };
  };
  builder.upright({0, 2, 0}, {0, -1, 0}, 200, 200, 1, plain(50));
  builder.upright({x, 1.9999, z}, {0, -1, 0}, 0.06, 0.06, 200, plain(250));
  return builder.build();
}

// Centre of what is brighter than the wall.
Vector2d bright_centre(const cv::Mat& radiance) {
  Vector2d sum(0, 0);
  double weight = 0, ground = 1e9;
  cv::minMaxLoc(radiance, &ground, nullptr);
  for (int y = 0; y < radiance.rows; ++y) {
    for (int x = 0; x < radiance.cols; ++x) {
      const double w = radiance.at<float>(y, x) - ground;
      sum += w * Vector2d(x, y);
      weight += w;
    }
  }
  return sum / weight;
}

// How far marks are drawn from where the camera model has them, pixels.
struct MarkError {
  double worst = 0;
  Vector2d mean{0, 0};
};

MarkError mark_error(const Camera& camera) {
  MarkError error;
  const Rigid3 pose = camera_pose({0.1, 0.2, -0.1}, std::numbers::pi / 2 + 0.1, 0.05, 0.2);
  for (const double x : {-0.7, 0.0, 0.6}) {
    for (const double z : {-0.5, 0.3}) {
      const Renderer renderer(wall_with_mark(x, z), camera, 1);
      const auto expected = camera.project(pose.inverse() * Vector3d(x, 1.9999, z));
      if (!expected) return {1e9, {}};
      const Vector2d off = bright_centre(renderer.render(pose).radiance) - *expected;
      error.worst = std::max(error.worst, off.norm());
      error.mean += off / 6;
    }
  }
  return error;
}

// Sixteen sub-samples a pixel leave a few hundredths of a pixel at random, but no bias.
void expect_marks_in_place(const Camera& camera) {
  const MarkError error = mark_error(camera);
  EXPECT_LT(error.worst, 0.08);
  EXPECT_LT(error.mean.norm(), 0.03) << error.mean.transpose();
}

TEST(Renderer, DrawsMarksWhereAPinholeSeesThem) {
  expect_marks_in_place(small_pinhole());
}

TEST(Renderer, DrawsMarksWhereARadialTangentialLensSeesThem) {
  expect_marks_in_place(Camera(LensModel::kPinhole, 160, 120, {130, 130, 79.5, 59.5},
                               {-0.28, 0.07, 0.0002, 0.00002, 0}));
}

TEST(Renderer, DrawsMarksWhereAFisheyeSeesThem) {
  expect_marks_in_place(
      Camera(LensModel::kFisheye, 160, 120, {80, 80, 79.5, 59.5}, {-0.01, 0.02, -0.005, 0.001, 0}));
}

TEST(Renderer, DepthIsTheDistanceOfTheWallAlongTheOpticalAxis) {
  const Renderer renderer(wall_with_mark(0, 0), small_pinhole(), 1);
  const Rigid3 pose = camera_pose({0, 0, 0}, std::numbers::pi / 2, 0, 0);
  const cv::Mat depth = renderer.render(pose).depth;
  for (const auto& [x, y] : {std::pair{3, 5}, {80, 20}, {150, 110}}) {
    EXPECT_NEAR(depth.at<float>(y, x), 2.0, 1e-5);
  }
}

TEST(Renderer, OneSidedSurfacesAreNotSeenFromBehind) {
  const Renderer renderer(wall_with_mark(0, 0), small_pinhole(), 1);
  const Rigid3 behind = camera_pose({0, 4, 0}, -std::numbers::pi / 2, 0, 0);
  EXPECT_EQ(cv::countNonZero(renderer.render(behind).depth), 0);
}

TEST(Renderer, ASurfaceRightBeforeTheCameraIsClippedNotLost) {
  SceneBuilder builder("floor", 1);
  builder.level({0, 0, 0}, 0, 10, 10, 20, [](Random&, const paint::Area& area) {
    return cv::Mat(area.rows(), area.columns(), CV_32F, cv::Scalar(100));
  });
  const Renderer renderer(builder.build(), small_pinhole(), 1);
  // The floor runs on below and behind the camera, which looks ahead, level.
  const cv::Mat depth = renderer.render(camera_pose({0, 0, 1}, 0.3, 0, 0)).depth;
  EXPECT_EQ(cv::countNonZero(depth.rowRange(0, 60)), 0);
  EXPECT_NEAR(depth.at<float>(119, 80), 130.0 / 59.5, 1e-4);
}

class SceneViews : public testing::TestWithParam<const char*> {};

// A pixel of one view, taken to the world by its depth and on to another view, has there the depth
// and about the grey level that the other view shows, unless something stands before it.
TEST_P(SceneViews, AgreeWithEachOtherThroughDepthAndPose) {
  const auto scene = make_scene(GetParam(), 3);
  ASSERT_TRUE(scene.ok());
  const auto trajectory = Trajectory::make(GetParam(), 0, 3);
  ASSERT_TRUE(trajectory.ok());
  const Camera camera = small_pinhole();
  const PinholeCamera pinhole = camera.ideal(0);
  const Renderer renderer(*scene, camera, 1);
  const Rigid3 first = trajectory->world_from_camera(1.0);
  const Rigid3 second = trajectory->world_from_camera(1.3);
  const Rendering a = renderer.render(first), b = renderer.render(second);
  int compared = 0, same_depth = 0, same_level = 0;
  for (int y = 2; y < 118; y += 3) {
    for (int x = 2; x < 158; x += 3) {
      const double z = a.depth.at<float>(y, x);
      ASSERT_GT(z, 0.2);
      const Vector3d in_second = second.inverse() * (first * pinhole.unproject(Vector2d(x, y), z));
      const Vector2d pixel = pinhole.project(in_second);
      const int u = static_cast<int>(std::lround(pixel.x()));
      const int v = static_cast<int>(std::lround(pixel.y()));
      if (in_second.z() < 0.1 || u < 1 || v < 1 || u >= 159 || v >= 119) continue;
      ++compared;
      if (std::abs(b.depth.at<float>(v, u) - in_second.z()) < 0.03 * in_second.z()) ++same_depth;
      if (std::abs(b.radiance.at<float>(v, u) - a.radiance.at<float>(y, x)) < 40) ++same_level;
    }
  }
  EXPECT_GT(compared, 1000);
  EXPECT_GT(same_depth, 0.93 * compared);
  EXPECT_GT(same_level, 0.85 * compared);
}

INSTANTIATE_TEST_SUITE_P(Scenes, SceneViews,
                         testing::Values("desk", "corridor", "weak", "posters"));

TEST(Renderer, GivesTheSameBytesForAnyNumberOfThreads) {
  const auto scene = make_scene("desk", 2);
  ASSERT_TRUE(scene.ok());
  const Rigid3 pose = Trajectory::make("desk", 0, 2)->world_from_camera(2);
  const Rendering one = Renderer(*scene, small_pinhole(), 1).render(pose);
  const Rendering three = Renderer(*scene, small_pinhole(), 3).render(pose);
  EXPECT_EQ(cv::norm(one.radiance, three.radiance, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.depth, three.depth, cv::NORM_INF), 0);
}

TEST(Renderer, AveragesBordersOverThePixel) {
  const Renderer renderer(wall_with_mark(0, 0), small_pinhole(), 1);
  // 6 cm at 2 m are 3.9 pixels: brightness sums to the mark's area, wherever it lies between
  // pixels.
  for (const double shift : {0.0, 0.004, 0.009}) {
    const Rigid3 pose = camera_pose({shift, 0, 0}, std::numbers::pi / 2, 0, 0);
    const cv::Mat radiance = renderer.render(pose).radiance;
    double ground = 0, peak = 0;
    cv::minMaxLoc(radiance, &ground, &peak);
    const double area = cv::sum(radiance - ground)[0] / (peak - ground);
    EXPECT_NEAR(area, std::pow(0.06 * 130 / 1.9999, 2), 0.35) << shift;
  }
}

TEST(Scene, UnknownNamesListTheKnownOnes) {
  const auto scene = make_scene("attic", 1);
  ASSERT_FALSE(scene.ok());
  EXPECT_NE(scene.message().find("desk"), std::string::npos);
  EXPECT_NE(scene.message().find("attic"), std::string::npos);
}

}  // namespace
}  // namespace cairn::synthetic
