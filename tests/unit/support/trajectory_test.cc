#include "tests/support/trajectory.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "tests/support/scene.h"

namespace cairn::synthetic {
namespace {

using Eigen::Vector3d;

TEST(CameraPose, LooksWhereItIsTold) {
  const Rigid3 pose = camera_pose({1, 2, 3}, std::numbers::pi / 2, 0, 0);
  // Along y: forward is world y, right is world x, down is world -z.
  EXPECT_LT((pose * Vector3d(0, 0, 1) - Vector3d(1, 3, 3)).norm(), 1e-12);
  EXPECT_LT((pose * Vector3d(1, 0, 0) - Vector3d(2, 2, 3)).norm(), 1e-12);
  EXPECT_LT((pose * Vector3d(0, 1, 0) - Vector3d(1, 2, 2)).norm(), 1e-12);
}

class ScenePath : public testing::TestWithParam<const char*> {};

TEST_P(ScenePath, MovesAsAPersonDoesAndWithoutJumps) {
  for (int path = 0; path < 3; ++path) {
    const auto trajectory = Trajectory::make(GetParam(), path, 1);
    ASSERT_TRUE(trajectory.ok());
    constexpr double kStep = 1.0 / 30;
    Rigid3 last = trajectory->world_from_camera(0);
    Vector3d last_velocity = Vector3d::Zero();
    for (int i = 1; i * kStep < trajectory->period(); ++i) {
      const Rigid3 now = trajectory->world_from_camera(i * kStep);
      const Vector3d velocity = (now.translation - last.translation) / kStep;
      EXPECT_LT(velocity.norm(), 1.5);
      EXPECT_LT(rotation_angle(last.inverse() * now) / kStep, 1.3);
      if (i > 1) {
        EXPECT_LT((velocity - last_velocity).norm() / kStep, 6.0) << path << " " << i;
      }
      last_velocity = velocity;
      last = now;
    }
  }
}

TEST_P(ScenePath, PathsStartInDifferentPlaces) {
  const Rigid3 first = Trajectory::make(GetParam(), 0, 1)->world_from_camera(0);
  const Rigid3 second = Trajectory::make(GetParam(), 1, 1)->world_from_camera(0);
  EXPECT_GT(
      (first.translation - second.translation).norm() + rotation_angle(first.inverse() * second),
      0.3);
}

TEST_P(ScenePath, ComesBackToWhereItBegan) {
  const auto trajectory = Trajectory::make(GetParam(), 0, 1);
  const Rigid3 begin = trajectory->world_from_camera(0);
  const Rigid3 end = trajectory->world_from_camera(trajectory->period());
  // But for the hand's shake and slow up and down.
  EXPECT_LT((begin.translation - end.translation).norm(), 0.3);
  EXPECT_LT(rotation_angle(begin.inverse() * end), 0.3);
}

INSTANTIATE_TEST_SUITE_P(Scenes, ScenePath,
                         testing::Values("desk", "hall", "corridor", "weak", "textureless", "bare",
                                         "turn", "posters", "bricks"));

TEST(Trajectory, EverySceneHasOne) {
  for (const SceneInfo& scene : scene_list()) {
    EXPECT_TRUE(Trajectory::make(std::string(scene.name), 0, 1).ok()) << scene.name;
  }
}

TEST(Trajectory, TheCorridorTakesNineHundredFramesOrMore) {
  EXPECT_GE(Trajectory::make("corridor", 0, 1)->period() * 30, 900);
}

TEST(Trajectory, RejectsUnknownScenesAndNegativePaths) {
  EXPECT_FALSE(Trajectory::make("attic", 0, 1).ok());
  EXPECT_FALSE(Trajectory::make("desk", -1, 1).ok());
}

}  // namespace
}  // namespace cairn::synthetic
