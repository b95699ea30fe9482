// How often landmarks on trial (cull.h) are found where they should be.
#pragma once

#include <cstddef>
#include <vector>

#include "server/map/delta.h"
#include "server/mapping/cull.h"
#include "server/mapping/keyframe_view.h"

namespace cairn {

// For the keyframe `id`, once its matches are in: one `visible` for each landmark on trial that it
// sees or, of those that its `neighbours` most covisible keyframes see, should see
// (KeyframeView::project); one `found` for each that it sees, be it through one that is about to be
// fused with it. Landmarks that refer to this keyframe itself don't count: they come with one of
// each. Empty when the keyframe is gone.
std::vector<MapDelta::Sighting> sightings(const Map& map, KeyframeId id, GridCache& grids,
                                          std::size_t neighbours = 10,
                                          const std::vector<MapDelta::Fusion>& fusions = {},
                                          const CullOptions& options = {});

}  // namespace cairn
