#include "server/verify/verify.h"

#include <algorithm>
#include <unordered_set>

#include <fmt/format.h>

#include "server/verify/doubt.h"

namespace cairn {
namespace {

std::unordered_set<LandmarkId> landmarks_of(const Map& map, const std::vector<KeyframeId>& group) {
  std::unordered_set<LandmarkId> all;
  for (const KeyframeId id : group)
    for (const LandmarkId l : map.keyframes.at(id).landmarks)
      if (l.is_valid()) all.insert(l);
  return all;
}

// Both sides, without what they share: it agrees with any loop and with none.
struct Sides {
  Sides(const Map& map, std::vector<KeyframeId> of_query, std::vector<KeyframeId> of_candidate) {
    for (const KeyframeId id : of_query)
      if (id != of_query.front()) std::erase(of_candidate, id);
    const auto known_to_query = landmarks_of(map, of_query);
    std::unordered_set<LandmarkId> shared;
    for (const LandmarkId l : landmarks_of(map, of_candidate))
      if (known_to_query.contains(l)) shared.insert(l);
    query = make_side(map, of_query, shared);
    candidate = make_side(map, of_candidate, shared);
  }

  Side query, candidate;
};

VerifiedLoop make_loop(const Sides& sides, const Sim3& candidate_from_query, const Grown& grown) {
  VerifiedLoop loop;
  loop.query = sides.query.views.front().node->keyframe->id;
  loop.candidate = sides.candidate.views.front().node->keyframe->id;
  loop.candidate_from_query = candidate_from_query;
  for (const auto& pair : grown.pairs)
    loop.same.push_back(
        {sides.query.landmarks[static_cast<std::size_t>(pair.query)].landmark->id,
         sides.candidate.landmarks[static_cast<std::size_t>(pair.candidate)].landmark->id});
  std::sort(loop.same.begin(), loop.same.end());
  loop.inliers = static_cast<int>(loop.same.size());
  return loop;
}

std::string why_not_comparable(const Map& map, KeyframeId query, KeyframeId candidate) {
  const KeyframeNode* node = map.keyframes.find(query);
  if (!node || !map.keyframes.contains(candidate)) return "one of the keyframes is not in the map";
  if (query == candidate) return "both keyframes are the same";
  for (const Covisible& c : node->covisible)
    if (c.keyframe == candidate) return "the keyframes share landmarks already";
  return {};
}

class Verifier {
 public:
  Verifier(const Map& map, KeyframeId query, KeyframeId candidate, const VerifyOptions& options)
      : options_(options),
        sides_(map, group_of(map, query, options.covisibles, options.min_shared),
               group_of(map, candidate, options.covisibles, options.min_shared)) {}

  Verification run() {
    v_.why = agree();
    if (v_.why.empty()) v_.why = grow_twice();
    if (v_.why.empty())
      v_.why = doubt(sides_.query, sides_.candidate, matches_, transform_, grown_, options_, v_);
    if (v_.why.empty()) v_.loop = make_loop(sides_, transform_, grown_);
    return v_;
  }

 private:
  // Steps 1 to 3.
  std::string agree() {
    const Side &query = sides_.query, &candidate = sides_.candidate;
    matches_ = match_sides(query, candidate, options_);
    v_.matches = static_cast<int>(matches_.best.size());
    const auto points = shared_points(query, candidate, matches_.best, options_.slack);
    const Consensus consensus = find_consensus(query, candidate, matches_.best, points, options_);
    v_.consensus = static_cast<int>(consensus.inliers.size());
    if (v_.consensus < options_.min_consensus)
      return fmt::format("{} of {} matches agree, fewer than {}", v_.consensus, v_.matches,
                         options_.min_consensus);
    std::vector<SharedPoint> inliers;
    for (const int i : consensus.inliers) inliers.push_back(points[static_cast<std::size_t>(i)]);
    transform_ = consensus.candidate_from_query;
    return refine(inliers);
  }

  // Step 4. The first growth brings the points that the transform is refined with, the second one
  // what that makes agree.
  std::string grow_twice() {
    for (int round = 0; round < 2; ++round) {
      grown_ = grow(sides_.query, sides_.candidate, transform_, options_);
      v_.grown = static_cast<int>(grown_.pairs.size());
      if (v_.grown < options_.min_consensus)
        return fmt::format("{} inliers, fewer than {}", v_.grown, options_.min_inliers);
      if (const std::string why = refine(grown_.points); !why.empty()) return why;
    }
    return {};
  }

  std::string refine(const std::vector<SharedPoint>& points) {
    const auto refined =
        refine_relative_pose(transform_, points, {.fix_scale = options_.fix_scale});
    if (!refined) return "the transform can't be refined";
    transform_ = *refined;
    return {};
  }

  const VerifyOptions& options_;
  Sides sides_;
  Matches matches_;
  Sim3 transform_;  // candidate_from_query
  Grown grown_;
  Verification v_;
};

}  // namespace

Verification verify_loop(const Map& map, KeyframeId query, KeyframeId candidate,
                         const VerifyOptions& options) {
  Verification result;
  result.why = why_not_comparable(map, query, candidate);
  if (!result.why.empty()) return result;
  return Verifier(map, query, candidate, options).run();
}

}  // namespace cairn
