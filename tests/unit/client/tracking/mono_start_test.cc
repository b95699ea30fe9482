#include "client/tracking/mono_start.h"

#include <gtest/gtest.h>

#include <functional>

#include "client/tracking/motion_hypotheses.h"
#include "client/tracking/small_bundle.h"
#include "common/geometry/sim3.h"
#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;
using Path = std::function<Rigid3(int frame)>;

// 0.4 m/s to the side with a slow turn, as a hand would move.
Rigid3 sideways(int frame) {
  const double t = frame / 30.0;
  return {so3_exp({0.02 * std::sin(2 * t), 0.1 * t, 0.03 * t}), {0.4 * t, 0.05 * t, 0.1 * t}};
}

std::vector<Eigen::Vector3d> plane(unsigned seed, int count, double tilt) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> along(-3, 3);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    const double x = along(random), y = along(random);
    points.emplace_back(x, y, 2.5 + tilt * x);
  }
  return points;
}

// Feeds a camera's frames until the map starts.
struct Walk {
  std::shared_ptr<const Rig> rig = testing::mono_test_rig();
  FeatureWorld world;
  double sigma;
  MonoStart start{rig, {}};
  std::vector<Features> views;
  int frames = 0;  // given so far
  std::optional<StartMap> map;

  explicit Walk(FeatureWorld w, double noise = 0.3) : world(std::move(w)), sigma(noise) {}

  bool go(int count, const Path& path) {
    for (int i = 0; i < count && !map; ++i, ++frames) {
      views.push_back(world.view(*rig, path(frames), sigma, 10));
      map = start.add(frames * 33'000'000LL, views.back(), FeatureGrid(views.back(), rig->camera));
    }
    return map.has_value();
  }

  // Of the latest frame's pose against the truth, once the scale is taken out: radians, and the
  // share of the way.
  std::pair<double, double> pose_error(const Path& path, int reference = 0) const {
    const Rigid3 truth = path(reference).inverse() * path(frames - 1);
    const Rigid3& found = map->poses.back().reference_from_camera;
    const double turn = truth.rotation.angularDistance(found.rotation);
    return {turn, (truth.translation.normalized() - found.translation.normalized()).norm()};
  }
};

TEST(MonoStart, StartsOnAGeneralSceneWithinAThirdOfASecond) {
  Walk run(FeatureWorld(3));
  ASSERT_TRUE(run.go(30, sideways));
  EXPECT_LE(run.frames, 12);
  EXPECT_GE(run.map->points.size(), 40u);
  const auto [turn, way] = run.pose_error(sideways);
  EXPECT_LT(turn, 0.005);
  EXPECT_LT(way, 0.05);
  EXPECT_EQ(run.map->poses.size(), static_cast<std::size_t>(run.frames) - 1);
  EXPECT_EQ(run.map->reference_stamp_ns, 0);
}

TEST(MonoStart, PointsAreTrueUpToScaleAndTheirMedianDepthIsTheUnit) {
  Walk run(FeatureWorld(4));
  ASSERT_TRUE(run.go(30, sideways));
  const Rigid3 camera_from_world = sideways(run.frames - 1).inverse();
  std::vector<Eigen::Vector3d> found, truth;
  std::vector<double> depths;
  const Rigid3 camera_from_map = run.map->poses.back().reference_from_camera.inverse();
  for (const StartMap::Point& p : run.map->points) {
    found.push_back(camera_from_map * p.position);
    truth.push_back(camera_from_world * run.world.point_of(p.feature));
    depths.push_back(p.position.z());
  }
  const auto aligned = align_points(found, truth, true);
  ASSERT_TRUE(aligned);
  std::vector<double> errors;
  for (std::size_t i = 0; i < found.size(); ++i)
    errors.push_back((*aligned * found[i] - truth[i]).norm());
  std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
  EXPECT_LT(errors[errors.size() / 2], 0.1);
  std::nth_element(depths.begin(), depths.begin() + std::ssize(depths) / 2, depths.end());
  EXPECT_NEAR(depths[depths.size() / 2], MonoStartOptions{}.median_depth, 0.3);
}

TEST(MonoStart, StartsOnAPlaneWithTheRightOfItsTwoExplanations) {
  for (const double tilt : {0.0, 0.3, -0.5}) {
    Walk run(FeatureWorld(5, plane(5, 2000, tilt)));
    ASSERT_TRUE(run.go(60, sideways)) << tilt;
    const auto [turn, way] = run.pose_error(sideways);
    EXPECT_LT(turn, 0.01) << tilt;
    EXPECT_LT(way, 0.15) << tilt;
  }
}

TEST(MonoStart, ACameraThatOnlyTurnsNeverStarts) {
  const auto turning = [](int frame) {
    const double t = frame / 30.0;
    return Rigid3(so3_exp({0.2 * std::sin(1.5 * t), 0.5 * std::sin(t), 0.2 * std::sin(0.7 * t)}),
                  Eigen::Vector3d::Zero());
  };
  for (const unsigned seed : {1u, 2u, 3u}) {
    Walk run(FeatureWorld(seed), 0.8);
    EXPECT_FALSE(run.go(90, turning)) << "started after " << run.frames << " frames";
  }
}

TEST(MonoStart, WaitsForParallaxWithoutGivingUp) {
  const auto hesitant = [](int frame) { return sideways(std::max(0, frame - 300)); };
  Walk run(FeatureWorld(6));
  ASSERT_FALSE(run.go(300, hesitant));
  ASSERT_TRUE(run.go(30, hesitant));
  const auto [turn, way] = run.pose_error(hesitant);
  EXPECT_LT(turn, 0.005);
  EXPECT_LT(way, 0.05);
}

TEST(MonoStart, FewFeaturesWait) {
  Walk poor(FeatureWorld(7, 250));  // of which some 30 are in view
  EXPECT_FALSE(poor.go(30, sideways));
}

// The camera turns away from what the reference showed before it has moved.
TEST(MonoStart, TakesANewReferenceWhenTheOldOneIsOutOfView) {
  const auto turn_then_move = [](int frame) {
    const Rigid3 turned(so3_exp({0, 1.5 * std::min(frame, 20) / 20.0, 0}), Eigen::Vector3d::Zero());
    return frame <= 20 ? turned : turned * sideways(frame - 20);
  };
  Walk run(FeatureWorld(8));
  ASSERT_TRUE(run.go(60, turn_then_move));
  EXPECT_GT(run.map->reference_stamp_ns, 0);
  const int reference = static_cast<int>(run.map->reference_stamp_ns / 33'000'000);
  EXPECT_LT(run.pose_error(turn_then_move, reference).second, 0.1);
}

TEST(MonoStart, TheSameImagesGiveTheSameMap) {
  Walk first(FeatureWorld(9)), second(FeatureWorld(9));
  ASSERT_TRUE(first.go(30, sideways) && second.go(30, sideways));
  EXPECT_EQ(first.frames, second.frames);
  ASSERT_EQ(first.map->points.size(), second.map->points.size());
  for (std::size_t i = 0; i < first.map->points.size(); ++i)
    EXPECT_EQ(first.map->points[i].position, second.map->points[i].position);
}

TEST(MotionHypotheses, HoldTheTrueMotionOfAGeneralSceneAndOfAPlane) {
  const auto rig = testing::mono_test_rig();
  const Rigid3 b_from_a = sideways(15).inverse();
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const bool flat : {false, true}) {
    std::vector<PixelPair> pairs;
    for (int i = 0; i < 150; ++i) {
      const double z = flat ? 2.0 : 1 + 3 * unit(random);
      const Eigen::Vector3d p = rig->camera.unproject({640 * unit(random), 480 * unit(random)}, z);
      pairs.push_back({rig->camera.project(p), rig->camera.project(b_from_a * p)});
    }
    double best = 1;
    for (const Rigid3& m : motion_hypotheses(rig->camera, pairs))
      best = std::min(best, m.rotation.angularDistance(b_from_a.rotation) +
                                (m.translation - b_from_a.translation.normalized()).norm());
    EXPECT_LT(best, 1e-3) << (flat ? "plane" : "general");
  }
  EXPECT_TRUE(motion_hypotheses(rig->camera, {}).empty());
}

TEST(SmallBundle, FindsBackWhatItWasMovedFrom) {
  const PinholeCamera camera = testing::mono_test_rig()->camera;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(-1, 1);
  SmallBundle bundle;
  for (int v = 0; v < 4; ++v) bundle.camera_from_map.push_back(sideways(8 * v).inverse());
  for (std::uint32_t p = 0; p < 60; ++p) {
    bundle.points.emplace_back(unit(random), unit(random), 2.5 + unit(random));
    for (std::uint32_t v = 0; v < 4; ++v)
      bundle.sights.push_back(
          {v, p, camera.project(bundle.camera_from_map[v] * bundle.points[p]), 1});
  }
  const SmallBundle truth = bundle;
  for (std::size_t v = 1; v < 4; ++v) {
    Eigen::Matrix<double, 6, 1> off;
    for (int i = 0; i < 6; ++i) off[i] = 0.02 * unit(random);
    bundle.camera_from_map[v] = perturbed(bundle.camera_from_map[v], off);
  }
  for (Eigen::Vector3d& p : bundle.points)
    p += 0.1 * Eigen::Vector3d(unit(random), unit(random), 1);
  EXPECT_LT(solve_small_bundle(camera, bundle, 30), 1e-6);
  const double scale =
      bundle.camera_from_map[3].translation.norm() / truth.camera_from_map[3].translation.norm();
  for (std::size_t p = 0; p < truth.points.size(); ++p)
    EXPECT_LT((bundle.points[p] - scale * truth.points[p]).norm(), 1e-4);
  EXPECT_EQ(bundle.camera_from_map[0].translation, truth.camera_from_map[0].translation);
}

// One wrong sight must not bend what the others say.
TEST(SmallBundle, ToleratesAWrongSight) {
  const PinholeCamera camera = testing::mono_test_rig()->camera;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  SmallBundle bundle;
  for (int v = 0; v < 3; ++v) bundle.camera_from_map.push_back(sideways(10 * v).inverse());
  for (std::uint32_t p = 0; p < 80; ++p) {
    bundle.points.emplace_back(unit(random), unit(random), 2.5 + unit(random));
    for (std::uint32_t v = 0; v < 3; ++v)
      bundle.sights.push_back(
          {v, p, camera.project(bundle.camera_from_map[v] * bundle.points[p]), 1});
  }
  const Rigid3 truth = bundle.camera_from_map[2];
  bundle.sights[2].pixel += Eigen::Vector2d(60, -40);
  solve_small_bundle(camera, bundle, 30);
  EXPECT_LT(bundle.camera_from_map[2].rotation.angularDistance(truth.rotation), 1e-2);
  EXPECT_GT(sight_chi2(camera, bundle, bundle.sights[2]), 100);
  EXPECT_LT(sight_chi2(camera, bundle, bundle.sights[5]), 5);
}

}  // namespace
}  // namespace cairn
