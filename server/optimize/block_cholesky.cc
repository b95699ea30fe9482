#include "server/optimize/block_cholesky.h"

#include <algorithm>
#include <iterator>

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>

namespace cairn {
namespace {

constexpr int kSide = 6;

// An order of elimination that fills in little (approximate minimum degree): the place of each row.
std::vector<int> elimination_order(int size, const std::vector<std::pair<int, int>>& pairs) {
  std::vector<Eigen::Triplet<double>> entries;
  for (const auto& [row, column] : pairs) {
    entries.emplace_back(row, column, 1.0);
    if (row != column) entries.emplace_back(column, row, 1.0);
  }
  Eigen::SparseMatrix<double> pattern(size, size);
  pattern.setFromTriplets(entries.begin(), entries.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
  Eigen::AMDOrdering<int>()(pattern, order);
  std::vector<int> place_of(static_cast<std::size_t>(size));
  for (int place = 0; place < size; ++place)
    place_of[static_cast<std::size_t>(order.indices()[place])] = place;
  return place_of;
}

}  // namespace

BlockCholesky::BlockCholesky(int size, const std::vector<std::pair<int, int>>& pairs)
    : size_(size), place_of_(elimination_order(size, pairs)) {
  find_structure(pairs);
  factor_.resize(rows_.size());
  for (const auto& [row, column] : pairs) {
    const int a = place_of_[static_cast<std::size_t>(row)];
    const int b = place_of_[static_cast<std::size_t>(column)];
    const auto begin = rows_.begin() + static_cast<std::ptrdiff_t>(first(std::min(a, b)));
    const auto end = rows_.begin() + static_cast<std::ptrdiff_t>(last(std::min(a, b)));
    const auto at = std::lower_bound(begin, end, std::max(a, b));
    // The factor is the lower triangle: as it stands if the pair's row comes later.
    places_.push_back({static_cast<std::size_t>(at - rows_.begin()), a < b});
  }
}

// What a column has below its first entry the column of that entry has too, once the first one is
// eliminated.
void BlockCholesky::find_structure(const std::vector<std::pair<int, int>>& pairs) {
  std::vector<std::vector<int>> columns(static_cast<std::size_t>(size_));
  for (const auto& [row, column] : pairs) {
    const int a = place_of_[static_cast<std::size_t>(row)];
    const int b = place_of_[static_cast<std::size_t>(column)];
    columns[static_cast<std::size_t>(std::min(a, b))].push_back(std::max(a, b));
  }
  first_.push_back(0);
  for (auto& column : columns) {
    std::sort(column.begin(), column.end());
    column.erase(std::unique(column.begin(), column.end()), column.end());
    rows_.insert(rows_.end(), column.begin(), column.end());
    first_.push_back(rows_.size());
    if (column.size() < 2) continue;
    auto& next = columns[static_cast<std::size_t>(column[1])];
    next.insert(next.end(), column.begin() + 1, column.end());
    column = {};
  }
}

bool BlockCholesky::factorize(const std::vector<Matrix6>& blocks) {
  for (Matrix6& block : factor_) block.setZero();
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    Matrix6& block = factor_[places_[i].block];
    if (places_[i].transposed)
      block = blocks[i].transpose();
    else
      block = blocks[i];
  }
  for (int column = 0; column < size_; ++column)
    if (!eliminate(column)) return false;
  return true;
}

// Right-looking: what the column subtracts from those that follow goes there at once.
bool BlockCholesky::eliminate(int column) {
  const std::size_t begin = first(column), end = last(column);
  const Eigen::LLT<Matrix6> diagonal(factor_[begin]);
  if (diagonal.info() != Eigen::Success) return false;
  factor_[begin] = diagonal.matrixL();
  for (std::size_t b = begin + 1; b < end; ++b)
    diagonal.matrixU().solveInPlace<Eigen::OnTheRight>(factor_[b]);
  for (std::size_t b = begin + 1; b < end; ++b) {
    std::size_t target = first(rows_[b]);
    for (std::size_t a = b; a < end; ++a) {
      while (rows_[target] != rows_[a]) ++target;
      factor_[target].noalias() -= factor_[a].lazyProduct(factor_[b].transpose());
    }
  }
  return true;
}

void BlockCholesky::solve_in_place(Eigen::VectorXd& vector) const {
  Eigen::VectorXd x(kSide * size_);
  for (int row = 0; row < size_; ++row)
    x.segment<kSide>(kSide * place_of_[static_cast<std::size_t>(row)]) =
        vector.segment<kSide>(kSide * row);
  for (int column = 0; column < size_; ++column) {
    auto own = x.segment<kSide>(kSide * column);
    factor_[first(column)].triangularView<Eigen::Lower>().solveInPlace(own);
    for (std::size_t b = first(column) + 1; b < last(column); ++b)
      x.segment<kSide>(kSide * rows_[b]) -= factor_[b] * own;
  }
  for (int column = size_ - 1; column >= 0; --column) {
    auto own = x.segment<kSide>(kSide * column);
    for (std::size_t b = first(column) + 1; b < last(column); ++b)
      own -= factor_[b].transpose() * x.segment<kSide>(kSide * rows_[b]);
    factor_[first(column)].transpose().triangularView<Eigen::Upper>().solveInPlace(own);
  }
  for (int row = 0; row < size_; ++row)
    vector.segment<kSide>(kSide * row) =
        x.segment<kSide>(kSide * place_of_[static_cast<std::size_t>(row)]);
}

}  // namespace cairn
