// A landmark as clients are told of it.
#pragma once

#include "common/model/map_update.h"
#include "server/map/map.h"

namespace cairn {

LandmarkState state_of(const Landmark& landmark);

}  // namespace cairn
