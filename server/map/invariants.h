// Whether a map is what map.h says that it is. For tests and for maps that come from a file.
#pragma once

#include <string>
#include <vector>

#include "server/map/map.h"

namespace cairn {

// One line for each violation; empty for a valid map. Visits everything.
std::vector<std::string> check_invariants(const Map& map);

}  // namespace cairn
