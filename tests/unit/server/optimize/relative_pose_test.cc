#include "server/optimize/relative_pose.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace cairn {
namespace {

Keyframe camera_of(Sensor sensor) {
  Rig rig;
  rig.sensor = sensor;
  rig.camera = {500, 500, 319.5, 239.5, 640, 480, sensor == Sensor::kMono ? 0.0 : 0.08};
  Keyframe keyframe;
  keyframe.rig = std::make_shared<const Rig>(rig);
  return keyframe;
}

// Points that both groups know, each group with a camera beside its primary one.
struct TwoGroups {
  explicit TwoGroups(const Sim3& truth, double pixel_noise = 0, Sensor sensor = Sensor::kRgbd)
      : a_from_b(truth), keyframe(camera_of(sensor)), noise(pixel_noise) {
    std::uniform_real_distribution<double> side(-1.5, 1.5), deep(2, 5);
    for (int i = 0; i < 60; ++i) {
      const Eigen::Vector3d in_a(side(random), side(random), deep(random));
      const Eigen::Vector3d in_b = truth.inverse() * in_a;
      points.push_back(
          {see(in_a, in_b, i % 2 ? beside : Rigid3{}), see(in_b, in_a, i % 3 ? Rigid3{} : beside)});
    }
  }

  // `point` in the primary of the group that sees it, `other` as the other group has it.
  Sight see(const Eigen::Vector3d& point, const Eigen::Vector3d& other, const Rigid3& camera) {
    const Eigen::Vector3d p = camera * point;
    const Eigen::Vector2d pixel = keyframe.rig->camera.project(p);
    std::normal_distribution<double> normal;
    Feature f;
    f.x = static_cast<float>(pixel.x() + noise * normal(random));
    f.y = static_cast<float>(pixel.y() + noise * normal(random));
    if (keyframe.rig->camera.baseline > 0)
      f.disparity = static_cast<float>(keyframe.rig->camera.disparity(p.z()));
    return {other, keyframe, f, camera, 1.0};
  }

  Sim3 a_from_b;
  Keyframe keyframe;
  double noise;
  std::mt19937_64 random{4};
  Rigid3 beside{so3_exp({0.02, -0.1, 0}), {0.2, 0.05, -0.1}};
  std::vector<SharedPoint> points;
};

double distance(const Sim3& a, const Sim3& b) {
  const Sim3 d = a.inverse() * b;
  return d.translation.norm() + so3_log(d.rotation).norm() + std::abs(std::log(d.scale));
}

Sim3 beside(const Sim3& s) {
  return Sim3(so3_exp({0.02, -0.03, 0.01}), {0.05, -0.04, 0.06}, 1) * s;
}

TEST(RelativePose, FindsTheTransformFromANearOne) {
  const Sim3 truth(so3_exp({0.1, 0.4, -0.05}), {0.3, -0.2, 0.4}, 1);
  const TwoGroups groups(truth);
  const auto found = refine_relative_pose(beside(truth), groups.points, {});
  ASSERT_TRUE(found);
  EXPECT_LT(distance(*found, truth), 1e-5);
  EXPECT_EQ(found->scale, 1.0);
}

TEST(RelativePose, FindsTheScaleToo) {
  const Sim3 truth(so3_exp({0.1, 0.4, -0.05}), {0.3, -0.2, 0.4}, 1.7);
  const TwoGroups groups(truth, 0, Sensor::kMono);
  Sim3 start = beside(truth);
  start.scale = 1.5;
  const auto found = refine_relative_pose(start, groups.points, {.fix_scale = false});
  ASSERT_TRUE(found);
  EXPECT_LT(distance(*found, truth), 1e-5);
}

TEST(RelativePose, FewWrongPairsPullLittle) {
  const Sim3 truth(so3_exp({0.1, 0.4, -0.05}), {0.3, -0.2, 0.4}, 1);
  TwoGroups groups(truth, 0.5);
  for (std::size_t i = 0; i < groups.points.size(); i += 10) groups.points[i].in_a.u += 40;
  const auto found = refine_relative_pose(beside(truth), groups.points, {});
  ASSERT_TRUE(found);
  EXPECT_LT(distance(*found, truth), 0.02);
}

TEST(RelativePose, NeedsThreePoints) {
  const TwoGroups groups{Sim3{}};
  EXPECT_FALSE(refine_relative_pose({}, std::span(groups.points).first(2), {}));
}

TEST(RelativePose, SightErrorsAreInStandardDeviations) {
  const Keyframe keyframe = camera_of(Sensor::kRgbd);
  Feature f;
  f.x = 319.5f + 3;
  f.y = 239.5f + 4;
  f.octave = 0;
  EXPECT_NEAR(Sight({0, 0, 2}, keyframe, f, {}, 1).chi2({}), 25, 1e-9);
  EXPECT_NEAR(Sight({0, 0, 2}, keyframe, f, {}, 2).chi2({}), 25 / 4.0, 1e-9);
  f.disparity = 20 + 5;  // 500 * 0.08 / 2 = 20
  EXPECT_NEAR(Sight({0, 0, 2}, keyframe, f, {}, 1).chi2({}), 50, 1e-9);
  EXPECT_TRUE(std::isinf(Sight({0, 0, -2}, keyframe, f, {}, 1).chi2({})));
}

}  // namespace
}  // namespace cairn
