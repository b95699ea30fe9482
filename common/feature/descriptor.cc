#include "common/feature/descriptor.h"

#include <algorithm>
#include <vector>

#include "common/feature/hamming.h"

namespace cairn {

std::size_t median_descriptor(std::span<const Descriptor> descriptors) {
  const std::size_t n = descriptors.size();
  if (n < 3) return 0;
  std::vector<int> distances(n * n, 0);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j)
      distances[i * n + j] = distances[j * n + i] =
          hamming_distance(descriptors[i], descriptors[j]);

  std::size_t best = 0;
  int best_median = 257;
  for (std::size_t i = 0; i < n; ++i) {
    const auto row = distances.begin() + static_cast<std::ptrdiff_t>(i * n);
    const auto end = row + static_cast<std::ptrdiff_t>(n);
    // The distance to itself (0) sorts first: entry n / 2 is the (upper) median of the others.
    const auto middle = row + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(row, middle, end);
    if (*middle < best_median) {
      best_median = *middle;
      best = i;
    }
  }
  return best;
}

}  // namespace cairn
