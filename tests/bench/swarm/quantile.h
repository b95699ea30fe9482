#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace cairn::bench {

// NaN of nothing.
inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return NAN;
  std::sort(values.begin(), values.end());
  const auto last = static_cast<double>(values.size() - 1);
  return values[static_cast<std::size_t>(std::ceil(share * last))];
}

}  // namespace cairn::bench
