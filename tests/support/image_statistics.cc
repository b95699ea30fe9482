#include "tests/support/image_statistics.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cairn::synthetic {

std::vector<double> block_entropies(const cv::Mat& gray, int side) {
  std::vector<double> entropies;
  for (int top = 0; top + side <= gray.rows; top += side) {
    for (int left = 0; left + side <= gray.cols; left += side) {
      std::array<int, 256> histogram{};
      for (int y = top; y < top + side; ++y) {
        const auto* row = gray.ptr<unsigned char>(y);
        for (int x = left; x < left + side; ++x) ++histogram[row[x]];
      }
      double entropy = 0;
      for (const int count : histogram) {
        if (count == 0) continue;
        const double p = static_cast<double>(count) / (side * side);
        entropy -= p * std::log2(p);
      }
      entropies.push_back(entropy);
    }
  }
  return entropies;
}

double percentile(std::vector<double> values, double share) {
  const auto index = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + index, values.end());
  return values[index];
}

}  // namespace cairn::synthetic
