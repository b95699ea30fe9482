// Pairs of keyframes as verification sees them, next to the truth.
#pragma once

#include <functional>
#include <vector>

#include "server/place/vocabulary.h"
#include "server/verify/verify.h"
#include "tests/bench/loops/known_map.h"

namespace cairn::bench {

struct JudgedPair {
  KeyframeId query, candidate;
  Verification verification;
  double distance_m = 0, turn_rad = 0;  // between the two, in truth
  double off_m = 0, off_rad = 0;        // of the loop from the truth, where there is one
  double milliseconds = 0;

  // So near to each other that they should be found to be one place.
  bool is_near() const { return distance_m < 0.6 && turn_rad < 0.5; }
  // Further off than the maps themselves are in places (a recording's up to 0.13 m), and less than
  // a wall of bricks repeats at.
  bool is_wrong() const { return verification.loop && (off_m > 0.2 || off_rad > 0.2); }
};

JudgedPair judge(const KnownMap& known, KeyframeId query, KeyframeId candidate,
                 const VerifyOptions& options);

struct KeyframePair {
  KeyframeId query, candidate;
};
// Pairs that share no landmark and whose truth is known: all of those that are near to each other,
// and of the others every n-th, so that there are `most` of these at most.
std::vector<KeyframePair> some_pairs(
    const KnownMap& known, std::size_t most,
    const std::function<bool(KeyframeId query, KeyframeId candidate)>& wanted = {});
std::vector<JudgedPair> judge_all(const KnownMap& known, const std::vector<KeyframePair>& pairs,
                                  const VerifyOptions& options);

// The candidates that recognition has for each keyframe, in the order of their arrival.
std::vector<JudgedPair> judge_candidates(const KnownMap& known, const Vocabulary& vocabulary,
                                         const VerifyOptions& options);

// Events of the map: closed loops that are further off than is_wrong() allows.
int wrong_events(const KnownMap& known);

}  // namespace cairn::bench
