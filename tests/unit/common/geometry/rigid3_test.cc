#include "common/geometry/rigid3.h"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

Eigen::Vector3d random_vector(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> d(-size, size);
  return {d(random), d(random), d(random)};
}
Rigid3 random_rigid(std::mt19937& random) {
  return {so3_exp(random_vector(random, 1.8)), random_vector(random, 5)};
}
void expect_same(const Rigid3& a, const Rigid3& b, double tolerance = 1e-12) {
  EXPECT_LT((a.translation - b.translation).norm(), tolerance);
  EXPECT_LT(a.rotation.angularDistance(b.rotation), tolerance);
}

TEST(So3, QuarterTurnAboutZTakesXToY) {
  const Eigen::Vector3d turned = so3_exp({0, 0, M_PI / 2}) * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(turned.isApprox(Eigen::Vector3d::UnitY(), 1e-15));
}

TEST(So3, LogUndoesExpFromTinyToHalfATurn) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, -2, 3).normalized();
  for (const double angle : {0.0, 1e-14, 1e-9, 1e-8, 1e-7, 1e-4, 0.5, 2.0, 3.1, M_PI - 1e-9}) {
    const Eigen::Vector3d omega = angle * axis;
    EXPECT_LT((so3_log(so3_exp(omega)) - omega).norm(), 1e-12 + 1e-9 * (angle > 3.1)) << angle;
  }
}

TEST(So3, LogTakesTheShortWayForEitherSignOfTheQuaternion) {
  const Eigen::Quaterniond q = so3_exp({0, 0, 3 * M_PI / 2});  // three quarters one way
  EXPECT_TRUE(so3_log(q).isApprox(Eigen::Vector3d(0, 0, -M_PI / 2), 1e-12));
  const Eigen::Quaterniond negative(-q.coeffs());
  EXPECT_TRUE(so3_log(negative).isApprox(so3_log(q), 1e-12));
}

TEST(So3, SkewIsTheCrossProduct) {
  const Eigen::Vector3d v(1, 2, 3), w(-4, 5, 0.5);
  EXPECT_TRUE((skew(v) * w).isApprox(v.cross(w)));
  EXPECT_TRUE(skew(v).isApprox(-skew(v).transpose()));
}

TEST(Rigid3, ComposesAsItsMatricesDo) {
  std::mt19937 random(1);
  for (int i = 0; i < 20; ++i) {
    const Rigid3 c_from_b = random_rigid(random), b_from_a = random_rigid(random);
    EXPECT_TRUE((c_from_b * b_from_a).matrix().isApprox(c_from_b.matrix() * b_from_a.matrix()));
    const Eigen::Vector3d point_in_a = random_vector(random, 3);
    EXPECT_TRUE(((c_from_b * b_from_a) * point_in_a).isApprox(c_from_b * (b_from_a * point_in_a)));
    expect_same(b_from_a.inverse() * b_from_a, Rigid3());
  }
}

TEST(Rigid3, LongChainsStayRotations) {
  const Rigid3 step(so3_exp({0.01, 0.02, -0.03}), {0.1, 0, 0});
  Rigid3 sum;
  for (int i = 0; i < 100'000; ++i) sum = sum * step;
  EXPECT_NEAR(sum.rotation.norm(), 1, 1e-14);
}

TEST(Rigid3, FromMatrixRepairsRoundedRotations) {
  std::mt19937 random(2);
  const Rigid3 original = random_rigid(random);
  Eigen::Matrix4d rounded = original.matrix();
  rounded = (rounded * 1e4).array().round() / 1e4;
  const Rigid3 repaired = Rigid3::from_matrix(rounded);
  expect_same(repaired, original, 1e-3);
  EXPECT_NEAR(repaired.rotation.norm(), 1, 1e-14);
  // A mirror image is no rotation: the nearest one comes back.
  Eigen::Matrix4d mirrored = Eigen::Matrix4d::Identity();
  mirrored(2, 2) = -1;
  EXPECT_NEAR(Rigid3::from_matrix(mirrored).matrix().topLeftCorner(3, 3).determinant(), 1, 1e-12);
}

TEST(Rigid3, PerturbationTurnsFromTheLeftAndMoves) {
  std::mt19937 random(3);
  const Rigid3 pose = random_rigid(random);
  Vector6 delta;
  delta << 0.1, -0.2, 0.3, 1, 2, 3;
  const Rigid3 moved = perturbed(pose, delta);
  EXPECT_TRUE(moved.translation.isApprox(pose.translation + Eigen::Vector3d(1, 2, 3)));
  expect_same({moved.rotation * pose.rotation.conjugate(), Eigen::Vector3d::Zero()},
              {so3_exp({0.1, -0.2, 0.3}), Eigen::Vector3d::Zero()});
  expect_same(perturbed(pose, Vector6::Zero()), pose);
}

TEST(Rigid3, DerivativeOfAPointByThePerturbation) {
  // d(exp(w) R p + t + v) / d(w, v) at 0 is (-[R p]x, I): what every solver relies on.
  std::mt19937 random(4);
  const Rigid3 pose = random_rigid(random);
  const Eigen::Vector3d p = random_vector(random, 2);
  Eigen::Matrix<double, 3, 6> analytic;
  analytic << -skew(pose.rotation * p), Eigen::Matrix3d::Identity();
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const Vector6 h = kStep * Vector6::Unit(i);
    const Eigen::Vector3d numeric =
        (perturbed(pose, h) * p - perturbed(pose, -h) * p) / (2 * kStep);
    EXPECT_LT((analytic.col(i) - numeric).norm(), 1e-8) << i;
  }
}

TEST(Rigid3, InterpolatesBothParts) {
  const Rigid3 first, second(so3_exp({0, 0, 1}), {4, 0, -2});
  expect_same(interpolate(first, second, 0), first);
  expect_same(interpolate(first, second, 1), second);
  expect_same(interpolate(first, second, 0.25), Rigid3(so3_exp({0, 0, 0.25}), {1, 0, -0.5}));
}

TEST(Rigid3, RotationAngleIgnoresTranslation) {
  EXPECT_NEAR(rotation_angle({so3_exp({0, 0.7, 0}), {9, 9, 9}}), 0.7, 1e-14);
}

TEST(Rigid3, FinitenessLooksAtEveryNumber) {
  Rigid3 pose;
  EXPECT_TRUE(pose.is_finite());
  pose.translation.y() = NAN;
  EXPECT_FALSE(pose.is_finite());
  pose = Rigid3();
  pose.rotation.w() = INFINITY;
  EXPECT_FALSE(pose.is_finite());
}

}  // namespace
}  // namespace cairn
