// Takes out what does the map no good: landmarks that prove unreliable soon after they were made,
// and keyframes that say nothing which others don't.
#pragma once

#include <cstdint>
#include <vector>

#include "server/map/delta.h"

namespace cairn {

struct CullOptions {
  // Landmarks are on trial while their reference keyframe is among the `trial` keyframes of its
  // client before the new one.
  std::uint32_t trial = 3;
  std::size_t proven = 8;            // observations of one that needs no trial
  double min_found_share = 0.25;     // of the keyframes in which it should have been found
  std::uint32_t grace = 2;           // keyframes until it must have been seen often enough:
  std::size_t min_observations = 2;  // with depth
  std::size_t min_observations_mono = 3;

  // A keyframe is redundant when this share of its landmarks (those nearer than max_depth, where
  // depth is measured and there are min_landmarks of them) is seen in `enough_views` others at the
  // same or a finer scale.
  double redundant_share = 0.9;
  int enough_views = 3;
  std::uint32_t keep_newest = 3;    // keyframes of each client that stay in any case...
  std::uint64_t gone_after = 5000;  // ... unless its newest came so many events of the map ago
  std::size_t candidates = 30;      // most covisible ones that are looked at
  std::size_t min_landmarks = 20;   // with fewer, nothing is said about redundancy

  // A map larger than its budget tolerates less: the share that makes a keyframe redundant falls
  // evenly to `full_share` where the map is a fifth above either of these.
  std::size_t keyframe_budget = 3000, landmark_budget = 300'000;
  double full_share = 0.6;
  // So does a crowd, where one more view of the same is worth little and costs all of its
  // neighbours: from `crowd` keyframes on that show this share of what the keyframe shows, to twice
  // as many. So what a place costs does not grow with the visits to it. A client alone makes no
  // crowd (on TUM fr1/rpy and 7-Scenes kitchen 13 at the most, 6 and 9 in the median).
  std::size_t crowd = 15;
  double crowd_overlap = 0.2;
};

// The share of its landmarks that others must see for this keyframe of the map to be redundant.
double redundant_share(const Map& map, const KeyframeNode& node, const CullOptions& options);

// Whether landmarks_failing_trial() may still ask for this one. Landmarks of one keyframe are on
// trial together.
bool is_on_trial(const Map& map, KeyframeId reference, const CullOptions& options = {});
// Landmarks on trial that failed it by the time of the keyframe `newest`.
std::vector<LandmarkId> landmarks_failing_trial(const Map& map, KeyframeId newest,
                                                const CullOptions& options = {});

// Redundant keyframes among those covisible with one of `around`; never roots, those themselves,
// the newest of a client or what has not been through local mapping. What one removal takes away
// counts for the next. Deterministic.
MapDelta cull_keyframes(const Map& map, const std::vector<KeyframeId>& around,
                        const CullOptions& options = {});

}  // namespace cairn
