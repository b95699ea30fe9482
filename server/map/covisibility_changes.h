// By how much the numbers of shared landmarks have changed, summed up over an event: the many small
// changes of one event touch few pairs of keyframes, again and again.
#pragma once

#include <algorithm>
#include <cstddef>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/model/ids.h"

namespace cairn {

// A matrix over the keyframes touched, which are numbered as they come. Not thread-safe.
class CovisibilityChanges {
 public:
  // Of keyframes touched: from here on the matrix is large enough for take().
  static constexpr std::size_t kFull = 500;
  bool is_full() const { return numbers_.size() >= kFull; }

  // `keyframe` sees a landmark along with each of `others` from now on (change 1), or no longer
  // (-1). Itself among the others does not count.
  template <typename Observations>
  void add(KeyframeId keyframe, const Observations& others, int change) {
    const std::size_t a = number_of(keyframe);
    for (const auto& o : others) {
      const std::size_t b = number_of(o.keyframe);
      if (a == b) continue;
      at(a, b) += change;
      at(b, a) += change;
    }
  }

  // Calls f(keyframe, changes) for each keyframe with changes, in ascending order, so that the same
  // event does the same on every run; `changes` are pairs of the other keyframe, ascending, and a
  // number that is not 0, and may be changed. Empty afterwards.
  template <typename F>
  void take(F&& f) {
    std::vector<std::pair<KeyframeId, std::size_t>> order(numbers_.begin(), numbers_.end());
    std::sort(order.begin(), order.end());
    std::vector<std::pair<KeyframeId, int>> changes;
    for (const auto& [id, a] : order) {
      changes.clear();
      for (const auto& [other, b] : order)
        if (b < rows_[a].size() && rows_[a][b] != 0) changes.emplace_back(other, rows_[a][b]);
      if (!changes.empty()) f(id, changes);
    }
    numbers_.clear();
    rows_.clear();
  }

 private:
  std::size_t number_of(KeyframeId id) {
    const auto [entry, is_new] = numbers_.try_emplace(id, numbers_.size());
    if (is_new) rows_.emplace_back();
    return entry->second;
  }
  int& at(std::size_t a, std::size_t b) {
    if (rows_[a].size() <= b) rows_[a].resize(b + 1);
    return rows_[a][b];
  }

  std::unordered_map<KeyframeId, std::size_t> numbers_;
  std::vector<std::vector<int>> rows_;  // those numbered later may be missing at the end
};

}  // namespace cairn
