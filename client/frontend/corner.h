// A corner on one pyramid level, before it becomes a feature.
#pragma once

#include <cstdint>

namespace cairn {

struct Corner {
  std::int16_t x = 0, y = 0;  // pixels of the level
  std::int16_t score = 0;     // FAST score: contrast with the best arc, grey levels
};

}  // namespace cairn
