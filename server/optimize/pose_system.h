// The normal equations of a bundle's poses once the landmarks are eliminated: symmetric, in blocks
// of 6 x 6, one for each two poses that see a landmark in common. Private to server/optimize.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "server/optimize/block_cholesky.h"

namespace cairn {

// Which two poses see a landmark in common. A pose does with itself. A bit for any two.
class PosePairs {
 public:
  explicit PosePairs(int poses);
  void add(int row, int column) { is_pair_[index(row, column)] = true; }  // row <= column
  bool contains(int row, int column) const { return is_pair_[index(row, column)]; }
  int poses() const { return poses_; }
  // (row, column), column by column, ascending by row.
  std::vector<std::pair<int, int>> sorted() const;

 private:
  static std::size_t index(int row, int column) {
    const auto c = static_cast<std::size_t>(column);
    return c * (c + 1) / 2 + static_cast<std::size_t>(row);
  }
  int poses_;
  std::vector<bool> is_pair_;
};

// Not thread-safe.
class PoseSystem {
 public:
  explicit PoseSystem(const PosePairs& pairs) : PoseSystem(pairs.poses(), pairs.sorted()) {}

  int poses() const { return poses_; }
  void set_zero();
  // Of a pair, row <= column.
  Matrix6& block(int row, int column);
  // Six numbers a pose: the right-hand side, which becomes the solution.
  Eigen::VectorXd& vector() { return vector_; }
  // False where the matrix is not positive definite; the vector is of no use then.
  bool solve();

 private:
  PoseSystem(int poses, const std::vector<std::pair<int, int>>& pairs);

  int poses_;
  // Blocks column by column, ascending by row: those of a column are first_[column] up to
  // first_[column + 1].
  std::vector<std::size_t> first_;
  std::vector<int> rows_;
  std::vector<Matrix6> blocks_;
  Eigen::VectorXd vector_;
  BlockCholesky cholesky_;
};

}  // namespace cairn
