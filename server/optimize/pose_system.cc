#include "server/optimize/pose_system.h"

#include <algorithm>

namespace cairn {

PosePairs::PosePairs(int poses) : poses_(poses), is_pair_(index(0, poses)) {
  for (int pose = 0; pose < poses; ++pose) add(pose, pose);
}

std::vector<std::pair<int, int>> PosePairs::sorted() const {
  std::vector<std::pair<int, int>> pairs;
  for (int column = 0; column < poses_; ++column)
    for (int row = 0; row <= column; ++row)
      if (contains(row, column)) pairs.emplace_back(row, column);
  return pairs;
}

PoseSystem::PoseSystem(int poses, const std::vector<std::pair<int, int>>& pairs)
    : poses_(poses), first_{0}, cholesky_(poses, pairs) {
  for (const auto& [row, column] : pairs) {
    rows_.push_back(row);
    if (row == column) first_.push_back(rows_.size());  // the last of its column
  }
  blocks_.resize(rows_.size());
  vector_.resize(6 * poses_);
}

void PoseSystem::set_zero() {
  for (Matrix6& block : blocks_) block.setZero();
  vector_.setZero();
}

Matrix6& PoseSystem::block(int row, int column) {
  const auto c = static_cast<std::size_t>(column);
  const auto first = rows_.begin() + static_cast<std::ptrdiff_t>(first_[c]);
  const auto last = rows_.begin() + static_cast<std::ptrdiff_t>(first_[c + 1]);
  // Where no row is missing, it stands at its own number.
  const auto at = last - first == column + 1 ? first + row : std::lower_bound(first, last, row);
  return blocks_[static_cast<std::size_t>(at - rows_.begin())];
}

bool PoseSystem::solve() {
  if (!cholesky_.factorize(blocks_)) return false;
  cholesky_.solve_in_place(vector_);
  return vector_.allFinite();
}

}  // namespace cairn
