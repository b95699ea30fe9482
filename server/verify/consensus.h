// Step 2 of verification: the transform that most matches agree on. Private to server/verify.
#pragma once

#include <optional>
#include <vector>

#include "server/verify/matches.h"

namespace cairn {

// 99 % quantiles of chi-squared with two and three degrees of freedom.
inline constexpr double kChi2TwoLoose = 9.21, kChi2ThreeLoose = 11.34;

inline bool agrees(const Sight& sight, const Sim3& primary_from_other) {
  return sight.chi2(primary_from_other) <= (sight.has_depth ? kChi2ThreeLoose : kChi2TwoLoose);
}

// A match as errors in both sides' images; group a is the candidate, group b the query.
std::vector<SharedPoint> shared_points(const Side& query, const Side& candidate,
                                       const std::vector<LandmarkPair>& matches, double slack);

// Of both directions' errors. Indices, ascending.
std::vector<int> agreeing(const std::vector<SharedPoint>& points, const Sim3& candidate_from_query);

struct Consensus {
  Sim3 candidate_from_query;
  std::vector<int> inliers;  // indices of the matches
};

// Nothing when no three matches make a transform. Deterministic by options.seed.
Consensus find_consensus(const Side& query, const Side& candidate,
                         const std::vector<LandmarkPair>& matches,
                         const std::vector<SharedPoint>& points, const VerifyOptions& options);

}  // namespace cairn
