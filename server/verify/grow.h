// Step 4 of verification: with the transform known, everything that both sides know is searched for
// in the other's images. Private to server/verify.
#pragma once

#include <array>
#include <vector>

#include "server/verify/consensus.h"

namespace cairn {

// What became of the landmarks that should show in a part of an image.
struct Cell {
  int expected = 0, found = 0;
};
struct ImageEvidence {
  static constexpr int kColumns = 8, kRows = 6;
  std::array<Cell, kColumns * kRows> cells;
};

// Of each image of both sides, as the other side's landmarks should show there.
struct Evidence {
  std::vector<ImageEvidence> query, candidate;
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
