// Local bundle adjustment: the newest keyframes and what they see, with the older keyframes that
// see the same landmarks held fixed (Mur-Artal et al. 2015, section VI D).
#pragma once

#include <stop_token>

#include "server/map/delta.h"
#include "server/map/map.h"
#include "server/map/window.h"
#include "server/optimize/bundle_adjustment.h"

namespace cairn {

struct LocalBaOptions {
  BundleOptions bundle;
};
using LocalBaSummary = BundleSummary;

// Works on the snapshot alone and may run in any thread. The result is empty (but for its base
// revision) when there is nothing to solve or the solver failed; `summary` (may be null) says why.
MapDelta solve_local_ba(const Map& snapshot, const LocalWindow& window,
                        const LocalBaOptions& options, LocalBaSummary* summary = nullptr,
                        std::stop_token stop = {});

}  // namespace cairn
