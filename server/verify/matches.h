// Step 1 of verification: which landmark of one side may be which of the other, by descriptor.
// Private to server/verify.
#pragma once

#include <vector>

#include "server/verify/side.h"
#include "server/verify/verify.h"

namespace cairn {

struct LandmarkPair {
  int query = 0, candidate = 0;  // indices of the sides' landmarks
};

struct Matches {
  // Mutually nearest, distinctive on both sides, turned alike. Ascending in `query`.
  std::vector<LandmarkPair> best;
  // Everything that looks alike: for each landmark of the query its nearest few, distinctive or
  // not. For finding out whether the best are alone.
  std::vector<LandmarkPair> similar;
  // One a landmark of the query: nothing else on either side looks nearly as much like its match.
  std::vector<bool> distinctive;
};

Matches match_sides(const Side& query, const Side& candidate, const VerifyOptions& options);

}  // namespace cairn
