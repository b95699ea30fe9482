// The few most similar of what was compared, for telling whether the best one stands out.
#pragma once

#include <array>
#include <cstddef>

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
