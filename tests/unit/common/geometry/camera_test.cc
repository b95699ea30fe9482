#include "common/geometry/camera.h"

#include <cmath>

#include <gtest/gtest.h>

namespace cairn {
namespace {

// TUM freiburg1: a strong radial-tangential lens.
const Camera kPlain(LensModel::kPinhole, 640, 480, {500, 510, 320, 240}, {});
const Camera kRadtan(LensModel::kPinhole, 640, 480, {517.306, 516.469, 318.643, 255.314},
                     {0.262383, -0.953104, -0.005358, 0.002628, 1.163314});
const Camera kFisheye(LensModel::kFisheye, 512, 512, {190.97, 190.96, 254.93, 256.89},
                      {0.00348, 0.00071, -0.00205, 0.0002, 0});

template <typename F>
void for_each_pixel(const Camera& camera, int step, F&& f) {
  for (int y = 0; y < camera.height(); y += step)
    for (int x = 0; x < camera.width(); x += step) f(Eigen::Vector2d(x, y));
}

void expect_round_trip(const Camera& camera) {
  for_each_pixel(camera, 16, [&](const Eigen::Vector2d& pixel) {
    const auto ray = camera.unproject(pixel);
    ASSERT_TRUE(ray.has_value()) << pixel.transpose();
    EXPECT_NEAR(ray->norm(), 1, 1e-12);
    for (const double distance : {0.3, 7.0}) {
      const auto back = camera.project(distance * *ray);
      ASSERT_TRUE(back.has_value()) << pixel.transpose();
      EXPECT_LT((*back - pixel).norm(), 1e-6) << pixel.transpose();
    }
  });
}

void expect_jacobian(const Camera& camera) {
  constexpr double kStep = 1e-6;
  for_each_pixel(camera, 64, [&](const Eigen::Vector2d& pixel) {
    const Eigen::Vector3d p = 2.5 * *camera.unproject(pixel);
    const auto analytic = camera.projection_jacobian(p);
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d h = kStep * Eigen::Vector3d::Unit(i);
      const Eigen::Vector2d numeric =
          (*camera.project(p + h) - *camera.project(p - h)) / (2 * kStep);
      EXPECT_LT((analytic.col(i) - numeric).norm(), 1e-5) << pixel.transpose() << ", by " << i;
    }
  });
}

TEST(Camera, PlainPinholeProjectsByHand) {
  // u = 500 * 0.2 / 2 + 320 = 370, v = 510 * -0.4 / 2 + 240 = 138.
  const auto pixel = kPlain.project({0.2, -0.4, 2});
  ASSERT_TRUE(pixel.has_value());
  EXPECT_TRUE(pixel->isApprox(Eigen::Vector2d(370, 138)));
  EXPECT_FALSE(kPlain.has_distortion());
}

TEST(Camera, RadialTangentialByHand) {
  // At (0.5, 0) on the normalised plane r2 = 0.25. k1 = 0.1 scales by 1.025; p1 = 0.01 moves y by
  // p1 (r2 + 2 y^2) = 0.0025; p2 = 0.02 moves x by p2 (r2 + 2 x^2) = 0.015.
  const Camera camera(LensModel::kPinhole, 640, 480, {100, 100, 0, 0}, {0.1, 0, 0.01, 0.02, 0});
  const auto pixel = camera.project({1, 0, 2});
  ASSERT_TRUE(pixel.has_value());
  EXPECT_NEAR(pixel->x(), 100 * (0.5 * 1.025 + 0.015), 1e-12);
  EXPECT_NEAR(pixel->y(), 100 * 0.0025, 1e-12);
}

TEST(Camera, EquidistantByHand) {
  // 90 degrees to the right of the axis: theta = pi/2, with k1 = 0.1 theta_d = theta + 0.1 theta^3.
  const Camera camera(LensModel::kFisheye, 640, 480, {100, 100, 0, 0}, {0.1, 0, 0, 0, 0});
  const double theta = M_PI / 2;
  const auto pixel = camera.project({3, 0, 0});
  ASSERT_TRUE(pixel.has_value());
  EXPECT_NEAR(pixel->x(), 100 * (theta + 0.1 * std::pow(theta, 3)), 1e-9);
  EXPECT_NEAR(pixel->y(), 0, 1e-12);
}

TEST(Camera, UnprojectUndoesProjectOverTheWholeImage) {
  expect_round_trip(kPlain);
  expect_round_trip(kRadtan);
  expect_round_trip(kFisheye);
}

TEST(Camera, AnalyticJacobianIsTheNumericOne) {
  expect_jacobian(kPlain);
  expect_jacobian(kRadtan);
  expect_jacobian(kFisheye);
}

TEST(Camera, FisheyeJacobianOnTheAxis) {
  const auto j = kFisheye.projection_jacobian({0, 0, 2});
  EXPECT_NEAR(j(0, 0), 190.97 / 2, 1e-9);
  EXPECT_NEAR(j(1, 1), 190.96 / 2, 1e-9);
  EXPECT_EQ(j(0, 2), 0);
  const auto ray = kFisheye.unproject({254.93, 256.89});
  EXPECT_TRUE(ray->isApprox(Eigen::Vector3d::UnitZ()));
}

TEST(Camera, NothingIsSeenBehindAPinhole) {
  for (const double z : {0.0, -1.0, static_cast<double>(NAN)}) {
    EXPECT_FALSE(kRadtan.project({0.1, 0.1, z}).has_value()) << z;
    EXPECT_TRUE(kRadtan.projection_jacobian({0.1, 0.1, z}).isZero()) << z;
  }
}

TEST(Camera, NothingIsSeenWhereTheLensModelFoldsBack) {
  // r (1 - r^2) grows up to r = 1/sqrt(3) and falls from there on.
  const Camera camera(LensModel::kPinhole, 640, 480, {100, 100, 320, 240}, {-1, 0, 0, 0, 0});
  EXPECT_TRUE(camera.project({0.5, 0, 1}).has_value());
  EXPECT_FALSE(camera.project({0.7, 0, 1}).has_value());
  // Beyond the fold's own pixel no ray arrives: 100 * 2 / (3 sqrt(3)) = 38.5.
  EXPECT_TRUE(camera.unproject({320 + 38, 240}).has_value());
  EXPECT_FALSE(camera.unproject({320 + 39, 240}).has_value());
  EXPECT_FALSE(camera.unproject({NAN, 240}).has_value());
}

TEST(Camera, UndistortedPixelsBelongToTheIdealCamera) {
  const PinholeCamera ideal = kRadtan.ideal(0.1);
  EXPECT_EQ(ideal.fx, 517.306);
  EXPECT_EQ(ideal.width, 640);
  EXPECT_EQ(ideal.baseline, 0.1);
  const Eigen::Vector3d p(0.4, -0.3, 1.5);
  const auto undistorted = kRadtan.undistort(*kRadtan.project(p));
  ASSERT_TRUE(undistorted.has_value());
  EXPECT_LT((*undistorted - ideal.project(p)).norm(), 1e-6);
  // Without distortion a pixel stays itself, bit for bit.
  EXPECT_EQ(*kPlain.undistort({12.25, 7.5}), Eigen::Vector2d(12.25, 7.5));
  // A fisheye sees more than a pinhole can show.
  EXPECT_FALSE(kFisheye.undistort(*kFisheye.project({1, 0, 0})).has_value());
}

TEST(PinholeCamera, DisparityAndDepthAreInverse) {
  const PinholeCamera camera{.fx = 400, .fy = 400, .cx = 320, .cy = 240, .baseline = 0.1};
  EXPECT_DOUBLE_EQ(camera.disparity(2), 20);
  EXPECT_DOUBLE_EQ(camera.depth(20), 2);
  const Eigen::Vector3d p = camera.unproject({100, 50}, 4);
  EXPECT_DOUBLE_EQ(p.z(), 4);
  EXPECT_TRUE(camera.project(p).isApprox(Eigen::Vector2d(100, 50)));
}

TEST(PinholeCamera, AnalyticJacobianIsTheNumericOne) {
  const PinholeCamera camera{.fx = 400, .fy = 410, .cx = 320, .cy = 240, .baseline = 0.1};
  const auto measure = [&](const Eigen::Vector3d& p) {
    const Eigen::Vector2d uv = camera.project(p);
    return Eigen::Vector3d(uv.x(), uv.y(), camera.disparity(p.z()));
  };
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector3d& p : {Eigen::Vector3d(0.5, -0.7, 2), Eigen::Vector3d(-3, 1, 9)}) {
    const Eigen::Matrix3d analytic = camera.projection_jacobian(p);
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d h = kStep * Eigen::Vector3d::Unit(i);
      const Eigen::Vector3d numeric = (measure(p + h) - measure(p - h)) / (2 * kStep);
      EXPECT_LT((analytic.col(i) - numeric).norm(), 1e-6);
    }
  }
}

}  // namespace
}  // namespace cairn
