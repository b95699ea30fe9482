// Global bundle adjustment: all keyframes and landmarks of a part of the map at once, after a loop
// has been closed or parts have been merged (Mur-Artal et al. 2015, section VII E).
//
// Works on a snapshot, for seconds, in a thread of its own; what arrives in the meantime is carried
// along when the delta is applied (delta.h).
#pragma once

#include <stop_token>

#include "server/map/delta.h"
#include "server/map/map.h"
#include "server/optimize/bundle_adjustment.h"

namespace cairn {

struct GlobalBaOptions {
  // More steps and a finer end than local adjustment: it runs seldom, and what it leaves undone
  // nobody else does.
  BundleOptions bundle{.first_iterations = 10, .second_iterations = 20, .function_tolerance = 1e-5};
};
using GlobalBaSummary = BundleSummary;

// Adjusts the component of the covisibility graph that holds `part_of`; with one that is not valid,
// every component. The oldest keyframe of each component stays where it is. Landmarks that the
// solution says nothing about move with their reference keyframe.
//
// The delta is empty (but for its base revision) when there is nothing to solve, the solver failed,
// or it was asked to stop: half a solution is not worth a change of everything. It looks at `stop`
// between two steps; a step of 1000 keyframes takes about half a second.
MapDelta solve_global_ba(const Map& snapshot, KeyframeId part_of, const GlobalBaOptions& options,
                         GlobalBaSummary* summary = nullptr, std::stop_token stop = {});

}  // namespace cairn
