#include "common/geometry/sim3.h"

#include <cmath>

#include <random>
#include <vector>

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Points = std::vector<Eigen::Vector3d>;

const Sim3 kSimilarity(so3_exp({0.3, -0.8, 1.1}), {1, -2, 3}, 2.5);
const Sim3 kOther(so3_exp({-1.0, 0.2, 0.4}), {0.5, 4, -1}, 0.2);

Points random_points(int count) {
  std::mt19937 random(7);
  std::normal_distribution<double> d(0, 2);
  Points out;
  for (int i = 0; i < count; ++i) out.emplace_back(d(random), d(random), d(random));
  return out;
}
Points moved(const Points& points, const Sim3& b_from_a) {
  Points out;
  for (const auto& p : points) out.push_back(b_from_a * p);
  return out;
}

TEST(Sim3, ScalesThenTurnsThenMoves) {
  const Sim3 s(so3_exp({0, 0, M_PI / 2}), {10, 0, 0}, 3);
  EXPECT_TRUE((s * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(10, 3, 0)));
}

TEST(Sim3, InverseAndProductAgreeWithApplyingOneAfterTheOther) {
  for (const auto& p : random_points(10)) {
    EXPECT_TRUE((kSimilarity.inverse() * (kSimilarity * p)).isApprox(p, 1e-12));
    EXPECT_TRUE(((kSimilarity * kOther) * p).isApprox(kSimilarity * (kOther * p), 1e-12));
  }
  EXPECT_NEAR((kSimilarity * kOther).scale, 0.5, 1e-12);
  EXPECT_NEAR(kSimilarity.inverse().scale, 0.4, 1e-12);
}

TEST(Sim3, MovedPoseSeesMovedPointsInTheSameDirection) {
  const Rigid3 a_from_camera(so3_exp({0.2, 0.1, -0.5}), {1, 1, 2});
  const Rigid3 b_from_camera = kSimilarity.move_pose(a_from_camera);
  for (const auto& p_in_a : random_points(5)) {
    const Eigen::Vector3d before = a_from_camera.inverse() * p_in_a;
    const Eigen::Vector3d after = b_from_camera.inverse() * (kSimilarity * p_in_a);
    EXPECT_TRUE(after.isApprox(2.5 * before, 1e-12));
  }
}

TEST(Sim3, IsAPoseWithAUnit) {
  const Rigid3 rigid(so3_exp({0.1, -0.2, 0.3}), {1, 2, 3});
  const Sim3 scaled(rigid.rotation, rigid.translation, 2.5);
  EXPECT_EQ(scaled.pose().matrix(), rigid.matrix());
  const Eigen::Vector3d seen(0.4, -0.5, 2);
  EXPECT_LT((scaled * seen - rigid * (2.5 * seen)).norm(), 1e-12);
  EXPECT_LT(((scaled.matrix() * seen.homogeneous()).head<3>() - scaled * seen).norm(), 1e-12);
  EXPECT_TRUE(scaled.is_finite());
  EXPECT_FALSE(Sim3(rigid.rotation, rigid.translation, std::nan("")).is_finite());
}

TEST(Sim3, InOtherUnitsIsTheSameTransform) {
  const Sim3 b_from_a(so3_exp({0.1, -0.2, 0.3}), {1, 2, 3}, 0.7);
  const Eigen::Vector3d point(0.4, -0.5, 2);
  const double unit_a = 2, unit_b = 5;  // of the numbers' own
  const Sim3 told = in_units(b_from_a, unit_a, unit_b);
  EXPECT_LT((unit_b * (told * (point / unit_a)) - b_from_a * point).norm(), 1e-12);
  const Sim3 back = in_units(told, 1 / unit_a, 1 / unit_b);
  EXPECT_LT((back.matrix() - b_from_a.matrix()).norm(), 1e-12);
}

TEST(AlignPoints, FindsTheSimilarityThatMovedThem) {
  const Points a = random_points(12);
  const auto found = align_points(a, moved(a, kSimilarity), true);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->scale, 2.5, 1e-12);
  EXPECT_TRUE(found->translation.isApprox(kSimilarity.translation, 1e-12));
  EXPECT_LT(found->rotation.angularDistance(kSimilarity.rotation), 1e-12);
}

TEST(AlignPoints, WithoutScaleFindsTheRigidMotion) {
  const Points a = random_points(12);
  const Sim3 rigid(kSimilarity.rotation, kSimilarity.translation, 1);
  const auto found = align_points(a, moved(a, rigid), false);
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->scale, 1);
  EXPECT_TRUE(found->translation.isApprox(rigid.translation, 1e-12));
}

TEST(AlignPoints, MirroredFlatTriangleIsAHalfTurn) {
  // Mirrored in x; in three dimensions a half turn about y does the same, exactly, with scale 1.
  const Points a = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}};
  const Points b = {{0, 0, 0}, {-1, 0, 0}, {0, 2, 0}};
  const auto found = align_points(a, b, true);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->scale, 1, 1e-12);
  EXPECT_NEAR(so3_log(found->rotation).norm(), M_PI, 1e-9);
  for (int i = 0; i < 3; ++i) EXPECT_LT((*found * a[i] - b[i]).norm(), 1e-12);
}

TEST(AlignPoints, MirroredPointsGetARotationNotAReflection) {
  // Corners of a box and their mirror image in z. Turning can't undo that, and the least error is
  // left by no turn at all: the smallest extent is the one given up.
  Points a, b;
  for (const double x : {-3, 3})
    for (const double y : {-2, 2})
      for (const double z : {-1, 1}) {
        a.emplace_back(x, y, z);
        b.emplace_back(x, y, -z);
      }
  const auto found = align_points(a, b, true);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->rotation.toRotationMatrix().determinant(), 1, 1e-12);
  EXPECT_NEAR(so3_log(found->rotation).norm(), 0, 1e-9);
  // Umeyama eq. 42: (9 + 4 - 1) / (9 + 4 + 1).
  EXPECT_NEAR(found->scale, 12.0 / 14.0, 1e-12);
}

TEST(AlignPoints, LeastSquaresBeatsEveryNeighbour) {
  const Points a = random_points(20);
  Points b = moved(a, kSimilarity);
  std::mt19937 random(8);
  std::normal_distribution<double> noise(0, 0.1);
  for (auto& p : b) p += Eigen::Vector3d(noise(random), noise(random), noise(random));
  const auto cost = [&](const Sim3& s) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += (b[i] - s * a[i]).squaredNorm();
    return sum;
  };
  const auto best = align_points(a, b, true);
  ASSERT_TRUE(best.has_value());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      Sim3 near = *best;
      near.translation[axis] += step;
      EXPECT_GT(cost(near), cost(*best));
      near = *best;
      near.rotation = so3_exp(step * Eigen::Vector3d::Unit(axis)) * near.rotation;
      EXPECT_GT(cost(near), cost(*best));
      near = *best;
      near.scale += step;
      EXPECT_GT(cost(near), cost(*best));
    }
  }
}

TEST(AlignPoints, PointsInAPlaneAreEnough) {
  const Points a = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 1, 0}};
  const auto found = align_points(a, moved(a, kSimilarity), true);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(found->rotation.angularDistance(kSimilarity.rotation), 1e-9);
}

TEST(AlignPoints, DegenerateInputsGiveNothing) {
  const Points two = {{0, 0, 0}, {1, 0, 0}};
  EXPECT_FALSE(align_points(two, two, true).has_value());
  const Points line = {{0, 0, 0}, {1, 2, 3}, {2, 4, 6}, {-1, -2, -3}};
  EXPECT_FALSE(align_points(line, line, true).has_value());
  const Points same(5, Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(align_points(same, same, false).has_value());
  const Points three = random_points(3), four = random_points(4);
  EXPECT_FALSE(align_points(three, four, true).has_value());
  EXPECT_FALSE(align_points({}, {}, true).has_value());
}

}  // namespace
}  // namespace cairn
