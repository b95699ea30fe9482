// A landmark as clients are told of it.
#pragma once

#include <optional>

#include "common/model/map_update.h"
#include "server/map/map.h"

namespace cairn {

// `shown_by`: the feature of the client's own that it looks like, if any.
LandmarkState state_of(const Landmark& landmark, std::optional<OwnFeature> shown_by = {});

}  // namespace cairn
