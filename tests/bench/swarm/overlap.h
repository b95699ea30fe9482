// When clients could have been merged, from what is known of their walks, and when they were.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "tests/bench/swarm/recorded_walk.h"
#include "tests/bench/swarm/replayed_client.h"

namespace cairn::bench {

using WallTime = std::chrono::system_clock::time_point;

struct Meetings {
  std::optional<WallTime> first;  // two clients have sent keyframes of the same place
  std::optional<WallTime> all;    // every client is connected with every other by such keyframes
};

// By the true poses: of the points that either keyframe shows, 60 % lie in the other's image, and
// the two look at them from within 25 degrees.
Meetings find_meetings(const std::vector<RecordedWalk>& walks,
                       const std::vector<ReplayResult>& results);

// When the server's log says that parts were merged.
std::vector<WallTime> merges_in(const std::string& log);

}  // namespace cairn::bench
