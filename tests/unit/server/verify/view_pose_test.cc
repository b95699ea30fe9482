#include "server/verify/view_pose.h"

#include <gtest/gtest.h>

#include "tests/support/random.h"

namespace cairn {
namespace {

const Rigid3 kTruth{so3_exp({0.3, -0.2, 0.1}), {1, -0.5, 2}};  // camera from map

// Points before the camera, each seen by the feature of its number.
struct Seen {
  explicit Seen(int count, double noise = 0.5, bool depth = true) {
    auto rig = std::make_shared<Rig>();
    rig->camera = {500, 500, 319.5, 239.5, 640, 480, 0.08};
    view.rig = rig;
    synthetic::Random random(5);
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector3d p(random.uniform(-1, 1), random.uniform(-0.8, 0.8),
                              random.uniform(2, 4));
      const Eigen::Vector2d pixel = rig->camera.project(p);
      Feature f;
      f.x = static_cast<float>(pixel.x() + noise * random.normal());
      f.y = static_cast<float>(pixel.y() + noise * random.normal());
      if (depth) f.disparity = static_cast<float>(rig->camera.disparity(p.z()));
      view.features.points.push_back(f);
      view.features.descriptors.push_back({});
      sights.push_back({kTruth.inverse() * p, static_cast<std::uint16_t>(i)});
    }
  }
  std::vector<bool> refine() { return refine_view_pose(view, sights, 1, pose); }

  Keyframe view;
  std::vector<PointSight> sights;
  Rigid3 pose{kTruth.rotation * so3_exp({0.05, 0.05, -0.05}),
              kTruth.translation + Eigen::Vector3d(0.1, -0.1, 0.1)};
};

void expect_true(const Rigid3& pose, double rotation, double translation) {
  const Rigid3 error = kTruth.inverse() * pose;
  EXPECT_LT(rotation_angle(error), rotation);
  EXPECT_LT(error.translation.norm(), translation);
}

TEST(ViewPose, ComesBackFromADistance) {
  for (const bool depth : {true, false}) {
    Seen seen(60, 0, depth);
    const auto good = seen.refine();
    EXPECT_EQ(std::count(good.begin(), good.end(), true), 60);
    expect_true(seen.pose, 1e-5, 1e-4);
  }
}

TEST(ViewPose, LeavesOutWhatDoesNotAgree) {
  Seen seen(100);
  synthetic::Random random(6);
  for (std::size_t i = 0; i < 100; i += 3)
    seen.sights[i].point_in_map +=
        Eigen::Vector3d(random.uniform(0.2, 1), random.uniform(-1, -0.2), 0.3);
  const auto good = seen.refine();
  for (std::size_t i = 0; i < 100; i += 3) EXPECT_FALSE(good[i]) << i;
  EXPECT_GE(std::count(good.begin(), good.end(), true), 60);
  expect_true(seen.pose, 0.002, 0.006);
}

TEST(ViewPose, FewPointsLeaveThePoseAsItWas) {
  Seen seen(3);
  const Rigid3 before = seen.pose;
  EXPECT_EQ(seen.refine(), std::vector<bool>(3, false));
  EXPECT_EQ(seen.pose.translation, before.translation);
}

TEST(ViewPose, APointBehindTheCameraDisagrees) {
  Seen seen(20, 0);
  const PointSight behind{kTruth.inverse() * Eigen::Vector3d(0, 0, -2), 3};
  EXPECT_FALSE(agrees(seen.view, kTruth, behind, 1));
  seen.sights.push_back(behind);
  const auto good = seen.refine();
  EXPECT_FALSE(good.back());
  expect_true(seen.pose, 1e-4, 1e-3);
}

}  // namespace
}  // namespace cairn
