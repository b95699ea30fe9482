// Step 4 of verification: with the transform known, everything that both sides know is searched for
// in the other's images. Private to server/verify.
#pragma once

#include <vector>

#include "server/verify/consensus.h"

namespace cairn {

// What became of a landmark in the other side's images: in how many it should show, and in how many
// of those it was found. Images where something stands before it don't count.
struct Sought {
  int expected = 0, found = 0;
};

// Of every landmark of each side.
struct Evidence {
  std::vector<Sought> query, candidate;
};

struct Grown {
  // Each landmark at most once, both directions' errors small; ascending.
  std::vector<LandmarkPair> pairs;
  std::vector<SharedPoint> points;  // of the pairs
  Evidence evidence;
};

Grown grow(const Side& query, const Side& candidate, const Sim3& candidate_from_query,
           const VerifyOptions& options);

}  // namespace cairn
