// The few most similar of what was compared, for telling whether the best one stands out.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "common/feature/hamming.h"

namespace cairn {

struct Similar {
  int index = -1;      // none yet
  int distance = 257;  // bits; more than any two descriptors differ in
};

// Most similar first; of equals the first met.
template <std::size_t kCount>
using SimilarList = std::array<Similar, kCount>;

template <std::size_t kCount>
void offer(SimilarList<kCount>& list, Similar found) {
  if (found.distance >= list.back().distance) return;
  std::size_t at = kCount - 1;
  for (; at > 0 && found.distance < list[at - 1].distance; --at) list[at] = list[at - 1];
  list[at] = found;
}

template <std::size_t kCount>
struct SimilarLists {
  std::vector<SimilarList<kCount>> of_a, of_b;  // indices are of the other one's
};

// So many bits, and what differs by more does not matter: it is no match, and too far from what is
// one to make that less distinctive.
inline int distance_that_matters(int max_distance, float ratio) {
  return static_cast<int>(static_cast<float>(max_distance) / ratio) + 1;
}

// Compares all of `a` with all of `b`; what differs in `limit` bits or more is left out. Millions
// of comparisons: what is read in the inner loop lies side by side, and next to none passes the
// limit.
template <std::size_t kCount>
SimilarLists<kCount> compare_all(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                 int limit) {
  SimilarLists<kCount> lists{std::vector<SimilarList<kCount>>(a.size()),
                             std::vector<SimilarList<kCount>>(b.size())};
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Descriptor wanted = a[i];
    for (std::size_t j = 0; j < b.size(); ++j) {
      const int distance = hamming_distance(wanted, b[j]);
      if (distance >= limit) continue;
      offer(lists.of_a[i], {static_cast<int>(j), distance});
      offer(lists.of_b[j], {static_cast<int>(i), distance});
    }
  }
  return lists;
}

// The nearest is within `max_distance`, and within `ratio` times the nearest one elsewhere.
// same_place(a, b): whether two indices are one thing that is there twice.
template <std::size_t kCount, typename Same>
bool is_distinctive(const SimilarList<kCount>& list, int max_distance, float ratio,
                    Same&& same_place) {
  if (list[0].index < 0 || list[0].distance > max_distance) return false;
  for (std::size_t i = 1; i < kCount && list[i].index >= 0; ++i)
    if (!same_place(list[0].index, list[i].index))
      return static_cast<float>(list[0].distance) <= ratio * static_cast<float>(list[i].distance);
  return true;
}

}  // namespace cairn
