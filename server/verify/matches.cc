#include "server/verify/matches.h"

#include <algorithm>

#include "common/feature/matching.h"
#include "server/verify/similar_list.h"

namespace cairn {
namespace {

// So many of the most similar landmarks are looked at.
constexpr std::size_t kNearest = 4;
// Landmarks nearer to each other than this share of their distance from the camera are taken for
// one thing that the map holds twice.
constexpr double kSamePlace = 0.03;

using FoundList = SimilarList<kNearest>;

bool same_place(const Side& side, int a, int b) {
  const Eigen::Vector3d& p = side.landmarks[static_cast<std::size_t>(a)].position;
  const Eigen::Vector3d& q = side.landmarks[static_cast<std::size_t>(b)].position;
  return (p - q).norm() <= kSamePlace * p.norm();
}

bool is_distinctive(const Side& side, const FoundList& list, const VerifyOptions& options) {
  return is_distinctive(list, options.max_distance, options.ratio,
                        [&](int a, int b) { return same_place(side, a, b); });
}

std::vector<Descriptor> descriptors_of(const Side& side) {
  std::vector<Descriptor> all;
  all.reserve(side.landmarks.size());
  for (const SideLandmark& l : side.landmarks) all.push_back(l.landmark->descriptor);
  return all;
}

void keep_turned_alike(const Side& query, const Side& candidate,
                       std::vector<LandmarkPair>& matches) {
  std::vector<float> turns;
  for (const auto& m : matches)
    turns.push_back(
        candidate.feature_of(candidate.landmarks[static_cast<std::size_t>(m.candidate)]).angle -
        query.feature_of(query.landmarks[static_cast<std::size_t>(m.query)]).angle);
  const std::vector<bool> good = consistent_turns(turns);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < matches.size(); ++i)
    if (good[i]) matches[kept++] = matches[i];
  matches.resize(kept);
}

}  // namespace

Matches match_sides(const Side& query, const Side& candidate, const VerifyOptions& options) {
  const auto similar =
      compare_all<kNearest>(descriptors_of(query), descriptors_of(candidate),
                            distance_that_matters(options.max_distance, options.ratio));
  Matches matches;
  matches.distinctive.resize(query.landmarks.size());
  for (std::size_t i = 0; i < query.landmarks.size(); ++i) {
    const FoundList& list = similar.of_a[i];
    for (const Similar& found : list)
      if (found.index >= 0 && found.distance <= options.similar_distance)
        matches.similar.push_back({static_cast<int>(i), found.index});
    if (!is_distinctive(candidate, list, options)) continue;
    const FoundList& back = similar.of_b[static_cast<std::size_t>(list[0].index)];
    if (!is_distinctive(query, back, options)) continue;
    matches.distinctive[i] = same_place(query, static_cast<int>(i), back[0].index);
    if (back[0].index == static_cast<int>(i))
      matches.best.push_back({static_cast<int>(i), list[0].index});
  }
  keep_turned_alike(query, candidate, matches.best);
  return matches;
}

}  // namespace cairn
