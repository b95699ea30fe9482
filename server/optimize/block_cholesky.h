// Cholesky decomposition of sparse symmetric matrices of 6 x 6 blocks. Private to server/optimize.
//
// Eigen's sparse one goes number by number; by blocks the same takes a fifth of the time. Where no
// block is zero Eigen's dense one is a fifth faster.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

namespace cairn {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// One for a structure; the numbers may change from factorisation to factorisation. Not thread-safe.
class BlockCholesky {
 public:
  // `pairs`: (row, column) of the blocks, row <= column, each once; all of the diagonal are among
  // them.
  BlockCholesky(int size, const std::vector<std::pair<int, int>>& pairs);

  // `blocks` in the order of the pairs. False where the matrix is not positive definite.
  bool factorize(const std::vector<Matrix6>& blocks);
  // Six numbers a row: the right-hand side becomes the solution.
  void solve_in_place(Eigen::VectorXd& vector) const;

 private:
  // Where a block of the matrix stands in the factor.
  struct Place {
    std::size_t block;
    bool transposed;
  };
  // The blocks of a column, the diagonal one first, then ascending by row.
  std::size_t first(int column) const { return first_[static_cast<std::size_t>(column)]; }
  std::size_t last(int column) const { return first_[static_cast<std::size_t>(column) + 1]; }
  void find_structure(const std::vector<std::pair<int, int>>& pairs);
  bool eliminate(int column);

  int size_;
  std::vector<int> place_of_;  // row in the factor, by row of the matrix
  std::vector<std::size_t> first_;
  std::vector<int> rows_;        // by block of the factor
  std::vector<Matrix6> factor_;  // lower triangle, column by column
  std::vector<Place> places_;    // by pair
};

}  // namespace cairn
