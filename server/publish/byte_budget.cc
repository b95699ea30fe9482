#include "server/publish/byte_budget.h"

#include <algorithm>

namespace cairn {

void ByteBudget::advance(std::int64_t stamp_ns) {
  const std::int64_t before = now_ns_.value_or(stamp_ns);
  now_ns_ = std::max(before, stamp_ns);
  const double seconds = 1e-9 * static_cast<double>(*now_ns_ - before);
  available_ = std::min(most_saved_, available_ + seconds * bytes_per_s_);
}

}  // namespace cairn
