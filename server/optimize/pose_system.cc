#include "server/optimize/pose_system.h"

#include <algorithm>
#include <utility>

#include <Eigen/Cholesky>

namespace cairn {
namespace {

constexpr int kSide = 6;
// Up to so many poses, or from such a share of pairs among all, the dense solver is faster
// (measured with cairn_optimize_bench).
constexpr int kFew = 80;
constexpr double kDenseFrom = 0.3;

}  // namespace

PosePairs::PosePairs(int poses) : poses_(poses), is_pair_(index(0, poses)) {
  for (int pose = 0; pose < poses; ++pose) add(pose, pose);
}

PoseSystem::PoseSystem(const PosePairs& pairs) : poses_(pairs.poses()) {
  std::vector<std::pair<int, int>> places;
  for (int column = 0; column < poses_; ++column) {
    first_.push_back(rows_.size());
    for (int row = 0; row <= column; ++row) {
      if (!pairs.contains(row, column)) continue;
      rows_.push_back(row);
      places.emplace_back(row, column);
    }
  }
  first_.push_back(rows_.size());
  blocks_.resize(rows_.size());
  vector_.resize(kSide * poses_);
  const double all = 0.5 * poses_ * (poses_ + 1);
  if (poses_ > kFew && static_cast<double>(blocks_.size()) < kDenseFrom * all)
    sparse_.emplace(poses_, places);
}

void PoseSystem::set_zero() {
  for (Matrix6& block : blocks_) block.setZero();
  vector_.setZero();
}

Matrix6& PoseSystem::block(int row, int column) {
  const auto first = rows_.begin() + static_cast<std::ptrdiff_t>(first_[column]);
  const auto last = rows_.begin() + static_cast<std::ptrdiff_t>(first_[column + 1]);
  // Where no row is missing, it stands at its own number.
  const auto at = last - first == column + 1 ? first + row : std::lower_bound(first, last, row);
  return blocks_[static_cast<std::size_t>(at - rows_.begin())];
}

bool PoseSystem::solve() {
  if (!sparse_) return solve_dense() && vector_.allFinite();
  if (!sparse_->factorize(blocks_)) return false;
  sparse_->solve_in_place(vector_);
  return vector_.allFinite();
}

bool PoseSystem::solve_dense() {
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(kSide * poses_, kSide * poses_);
  for (int column = 0; column < poses_; ++column)
    for (std::size_t b = first_[column]; b < first_[column + 1]; ++b)
      // The lower triangle, which Eigen decomposes faster.
      matrix.block<kSide, kSide>(kSide * column, kSide * rows_[b]) = blocks_[b].transpose();
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> decomposed(matrix);
  if (decomposed.info() != Eigen::Success) return false;
  decomposed.solveInPlace(vector_);
  return true;
}

}  // namespace cairn
