#include "server/optimize/pose_system.h"

#include <random>

#include <gtest/gtest.h>
#include <Eigen/Cholesky>

namespace cairn {
namespace {

// A positive definite matrix: what each pair's landmark would add, and something for each pose.
struct RandomSystem {
  RandomSystem(const PosePairs& structure, std::uint64_t seed)
      : pairs(structure), matrix(Eigen::MatrixXd::Identity(6 * pairs.poses(), 6 * pairs.poses())) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    const auto number = [&] { return normal(random); };
    for (int column = 0; column < pairs.poses(); ++column)
      for (int row = 0; row <= column; ++row) {
        if (!pairs.contains(row, column)) continue;
        const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(6, 3, number);
        const Eigen::MatrixXd b = Eigen::MatrixXd::NullaryExpr(6, 3, number);
        block(row, row) += a * a.transpose();
        block(column, column) += b * b.transpose();
        if (row == column) continue;
        block(row, column) += a * b.transpose();
        block(column, row) += b * a.transpose();
      }
    right_side = Eigen::VectorXd::NullaryExpr(matrix.rows(), number);
  }

  Eigen::Block<Eigen::MatrixXd, 6, 6> block(int row, int column) {
    return matrix.block<6, 6>(6 * row, 6 * column);
  }
  void fill(PoseSystem& system) {
    system.set_zero();
    for (int column = 0; column < pairs.poses(); ++column)
      for (int row = 0; row <= column; ++row)
        if (pairs.contains(row, column)) system.block(row, column) = block(row, column);
    system.vector() = right_side;
  }
  Eigen::VectorXd solution() const { return matrix.llt().solve(right_side); }

  PosePairs pairs;
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right_side;
};

// Each sees something with the next few, and the last ones with the first: a loop.
PosePairs road(int poses, int reach) {
  PosePairs pairs(poses);
  for (int i = 0; i < poses; ++i)
    for (int k = 1; k <= reach; ++k) {
      const int other = (i + k) % poses;
      pairs.add(std::min(i, other), std::max(i, other));
    }
  return pairs;
}

PosePairs room(int poses) {
  PosePairs pairs(poses);
  for (int column = 0; column < poses; ++column)
    for (int row = 0; row < column; ++row) pairs.add(row, column);
  return pairs;
}

void expect_solved(const PosePairs& pairs) {
  PoseSystem system(pairs);
  for (const std::uint64_t seed : {1, 2}) {  // the second on what the first has left
    RandomSystem random(pairs, seed);
    random.fill(system);
    ASSERT_TRUE(system.solve());
    const Eigen::VectorXd expected = random.solution();
    EXPECT_LT((system.vector() - expected).norm(), 1e-9 * expected.norm());
  }
}

TEST(PoseSystem, SolvesASmallOne) {
  expect_solved(road(5, 1));
}

TEST(PoseSystem, SolvesALargeOneWithoutZeros) {
  expect_solved(room(90));
}

TEST(PoseSystem, SolvesALargeSparseOneWithALoop) {
  expect_solved(road(120, 3));
}

TEST(PoseSystem, SolvesOneOfPosesThatSeeNothingInCommon) {
  expect_solved(PosePairs(100));
}

TEST(PoseSystem, SaysWhenThereIsNoSolution) {
  for (const PosePairs& pairs : {road(5, 1), road(120, 3)}) {
    PoseSystem system(pairs);
    RandomSystem random(pairs, 3);
    random.fill(system);
    system.block(4, 4) = -Matrix6::Identity();
    EXPECT_FALSE(system.solve());
  }
}

TEST(PoseSystem, HasNoPosesAtAll) {
  PoseSystem system(PosePairs(0));
  system.set_zero();
  EXPECT_TRUE(system.solve());
}

}  // namespace
}  // namespace cairn
