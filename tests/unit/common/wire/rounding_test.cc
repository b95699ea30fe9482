#include "common/wire/rounding.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "common/wire/values.h"

namespace cairn::wire {
namespace {

using Eigen::Vector3d;

Vector3d any_direction(std::mt19937_64& random) {
  std::normal_distribution<double> d;
  return Vector3d(d(random), d(random), d(random)).normalized();
}

// The axes and the folds between them are where such maps go wrong.
std::vector<Vector3d> directions() {
  std::vector<Vector3d> all;
  for (int i = 0; i < 27; ++i)
    if (i != 13) all.push_back(Vector3d(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1).normalized());
  std::mt19937_64 random(1);
  for (int i = 0; i < 2000; ++i) all.push_back(any_direction(random));
  for (int i = 0; i < 200; ++i) {
    Vector3d d = any_direction(random);
    d[i % 3] = i % 2 == 0 ? 0.0 : -1e-9;
    all.push_back(d.normalized());
  }
  return all;
}

TEST(Rounding, PointsAreOffByNoMoreThanAShareOfTheirDistance) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> log_distance(std::log(0.002), std::log(9000.0));
  const Vector3d centre(3, -2, 10);
  for (const Vector3d& direction : directions()) {
    const double distance = std::exp(log_distance(random));
    const Vector3d point = centre + distance * direction;
    ByteWriter out;
    put_point(out, point, centre);
    const Blob blob = out.take();
    EXPECT_EQ(blob.size(), kPointBytes);
    ByteReader in(blob);
    const Vector3d got = get_point(in, centre) - centre;
    EXPECT_NEAR(got.norm() / distance, 1, 1.3e-4);
    EXPECT_LT(got.cross(direction).norm() / distance, 7e-5) << direction.transpose();
    EXPECT_GT(got.dot(direction), 0);
    // Once rounded it stays.
    ByteWriter again;
    put_point(again, got + centre, centre);
    const Blob second = again.take();
    ByteReader in_again(second);
    EXPECT_LT((get_point(in_again, centre) - centre - got).norm(), 1e-9 * distance);
  }
}

TEST(Rounding, BeyondTheRangeOfDistancesTheDirectionIsKept) {
  for (const double distance : {1e-6, 1e6}) {
    ByteWriter out;
    put_point(out, Vector3d(0.6, 0, 0.8) * distance, Vector3d::Zero());
    const Blob blob = out.take();
    ByteReader in(blob);
    EXPECT_LT((get_point(in, Vector3d::Zero()).normalized() - Vector3d(0.6, 0, 0.8)).norm(), 7e-5);
  }
  ByteWriter out;
  put_point(out, Vector3d(1, 2, 3), Vector3d(1, 2, 3));
  const Blob blob = out.take();
  ByteReader in(blob);
  EXPECT_LT((get_point(in, Vector3d(1, 2, 3)) - Vector3d(1, 2, 3)).norm(), 2e-3);
}

TEST(Rounding, NormalsComeBackAndNoneStaysNone) {
  for (const Vector3d& direction : directions()) {
    ByteWriter out;
    put_normal(out, direction);
    const Blob blob = out.take();
    EXPECT_EQ(blob.size(), kNormalBytes);
    ByteReader in(blob);
    const Vector3d got = get_normal(in);
    EXPECT_LT((got - direction).norm(), 1.05e-3) << direction.transpose();
    ByteWriter again;
    put_normal(again, got);
    const Blob second = again.take();
    ByteReader in_again(second);
    EXPECT_LT((get_normal(in_again) - got).norm(), 1e-12);
  }
  ByteWriter out;
  put_normal(out, Vector3d::Zero());
  const Blob blob = out.take();
  ByteReader in(blob);
  EXPECT_EQ(get_normal(in), Vector3d::Zero());
}

TEST(Rounding, RangesOfDistances) {
  const std::pair<float, float> ranges[] = {
      {1.f, 3.583f}, {0.3f, 0.3f}, {0.f, 5.f}, {0.01f, 9000.f}};
  for (const auto& [near, far] : ranges) {
    ByteWriter out;
    put_range(out, near, far);
    const Blob blob = out.take();
    ByteReader in(blob);
    float n = -1, f = -1;
    get_range(in, n, f);
    EXPECT_NEAR(f / far, 1, 1.4e-4);
    const bool tiny = near < far / 240;
    EXPECT_NEAR(n, tiny ? 0 : near, 0.012 * near);
    EXPECT_LE(n, f);
    ByteWriter again;
    put_range(again, n, f);
    EXPECT_EQ(again.take(), blob);
  }
}

TEST(Rounding, PosesAreOffByMicroradians) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> d(-4, 4);
  const Vector3d centre(100, -50, 20);
  for (int i = 0; i < 500; ++i) {
    const Rigid3 pose(so3_exp({d(random), d(random), d(random)}),
                      centre + Vector3d(d(random), d(random), d(random)));
    ByteWriter out;
    put_pose(out, pose, centre);
    const Blob blob = out.take();
    EXPECT_EQ(blob.size(), kPoseBytes);
    ByteReader in(blob);
    const Rigid3 got = get_pose(in, centre);
    EXPECT_TRUE(is_sound(got));
    EXPECT_LT(got.rotation.angularDistance(pose.rotation), 4e-6);
    EXPECT_LT((got.translation - pose.translation).norm(), 1e-6);
  }
  ByteWriter out;
  put_pose(out, Rigid3(), Vector3d::Zero());
  const Blob blob = out.take();
  ByteReader in(blob);
  const Rigid3 identity = get_pose(in, Vector3d::Zero());
  EXPECT_EQ(identity.matrix(), Rigid3().matrix());
}

TEST(Rounding, BytesThatAreNoPoseAreNotTakenForOne) {
  const Blob high(kPoseBytes, 0xff);
  ByteReader in(high);
  EXPECT_FALSE(is_sound(get_pose(in, Vector3d::Zero())));
}

}  // namespace
}  // namespace cairn::wire
