#include "server/place/bag_of_words.h"

#include <algorithm>

namespace cairn {

double similarity(const BagOfWords& a, const BagOfWords& b) {
  double sum = 0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->word < j->word) {
      ++i;
    } else if (j->word < i->word) {
      ++j;
    } else {
      sum += std::min(i->weight, j->weight);
      ++i, ++j;
    }
  }
  return std::min(sum, 1.0);  // beyond it only by rounding
}

}  // namespace cairn
