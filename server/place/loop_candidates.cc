#include "server/place/loop_candidates.h"

#include <algorithm>
#include <unordered_map>

#include "server/map/connected.h"

namespace cairn {
namespace {

// Matches that are looked at, the best ones: what comes after so many leads no group.
constexpr std::size_t kMostGrouped = 200;

// The query, what it shares `least` landmarks with, and what shares as many with those.
std::unordered_set<KeyframeId> near_by(const Map& map, KeyframeId query, int least) {
  std::unordered_set<KeyframeId> near{query};
  std::vector<KeyframeId> last{query};
  for (int step = 0; step < 2; ++step) {
    std::vector<KeyframeId> next;
    for (const KeyframeId id : last) {
      for (const Covisible& c : map.keyframes.at(id).covisible) {
        if (c.shared < least) break;  // strongest first
        if (near.insert(c.keyframe).second) next.push_back(c.keyframe);
      }
    }
    last = std::move(next);
  }
  // Weaker neighbours see something of the same: their own neighbours may be far away.
  for (const Covisible& c : map.keyframes.at(query).covisible) near.insert(c.keyframe);
  return near;
}

// How alike a place must look.
double bar_of(const Map& map, const PlaceIndex& index, KeyframeId query, const BagOfWords& bag,
              const CandidateOptions& options) {
  double least = 2;
  int asked = 0;
  for (const Covisible& c : map.keyframes.at(query).covisible) {
    if (asked == options.bar_neighbours || c.shared < options.near_shared) break;
    const auto words = index.words_of(c.keyframe);
    if (!words) continue;
    least = std::min(least, similarity(bag, words->bag));
    ++asked;
  }
  const double bar = asked > 0 ? options.bar_share * least : 0.0;
  return std::max(bar, options.least_score);
}

// Gathers each match with those of its neighbours that match too. The best keyframe stands for the
// group; where groups share it the fuller one counts.
std::vector<LoopCandidate> grouped(const Map& map, const std::vector<PlaceMatch>& matches,
                                   const CandidateOptions& options) {
  std::unordered_map<KeyframeId, double> score_of;
  for (const PlaceMatch& match : matches) score_of[match.keyframe] = match.score;
  std::unordered_map<KeyframeId, LoopCandidate> best;
  for (const PlaceMatch& match : matches) {
    LoopCandidate candidate{match.keyframe, match.score, match.score, false};
    int asked = 0;
    for (const Covisible& c : map.keyframes.at(match.keyframe).covisible) {
      if (asked++ == options.group_neighbours) break;
      const auto it = score_of.find(c.keyframe);
      if (it == score_of.end()) continue;
      candidate.group_score += it->second;
      if (it->second > candidate.score)
        candidate.keyframe = it->first, candidate.score = it->second;
    }
    LoopCandidate& known = best.try_emplace(candidate.keyframe, candidate).first->second;
    if (candidate.group_score > known.group_score) known = candidate;
  }
  std::vector<LoopCandidate> candidates;
  for (const auto& [id, candidate] : best) candidates.push_back(candidate);
  std::sort(candidates.begin(), candidates.end(),
            [](const LoopCandidate& a, const LoopCandidate& b) {
              return a.group_score != b.group_score ? a.group_score > b.group_score
                                                    : a.keyframe < b.keyframe;
            });
  return candidates;
}

// The best matches, in groups that are not much worse than the best one.
std::vector<LoopCandidate> best_groups(const Map& map, std::vector<PlaceMatch> matches,
                                       const CandidateOptions& options) {
  if (matches.size() > kMostGrouped) matches.resize(kMostGrouped);
  std::vector<LoopCandidate> candidates = grouped(map, matches, options);
  if (candidates.empty()) return candidates;
  const double least = options.group_share * candidates.front().group_score;
  std::erase_if(candidates, [&](const LoopCandidate& c) { return c.group_score < least; });
  return candidates;
}

// A common root of the spanning tree tells quickly that two are connected. Where that says nothing
// (map files from before merged parts were hung on each other) the whole part is visited.
void mark_other_islands(const Map& map, KeyframeId query, std::vector<LoopCandidate>& candidates) {
  if (candidates.empty()) return;  // perhaps because the map does not have the query
  const KeyframeId root = root_of(map, query);
  std::vector<KeyframeId> island;
  for (LoopCandidate& candidate : candidates) {
    if (root_of(map, candidate.keyframe) == root) continue;
    if (island.empty()) island = connected_keyframes(map, query);
    candidate.other_island = !std::binary_search(island.begin(), island.end(), candidate.keyframe);
  }
}

}  // namespace

std::vector<LoopCandidate> find_candidates(const Map& map, const PlaceIndex& index,
                                           const BagOfWords& view,
                                           const CandidateOptions& options) {
  auto candidates =
      best_groups(map,
                  index.query(view, options.least_score,
                              [&](KeyframeId id) { return map.keyframes.contains(id); }),
                  options);
  const auto most = static_cast<std::size_t>(options.most);
  if (candidates.size() > most) candidates.resize(most);
  return candidates;
}

std::vector<LoopCandidate> LoopCandidates::find(const Map& map, const PlaceIndex& index,
                                                KeyframeId query) {
  std::vector<LoopCandidate> candidates;
  const auto words = index.words_of(query);
  if (words && map.keyframes.contains(query)) {
    const auto near = near_by(map, query, options_.near_shared);
    const double bar = bar_of(map, index, query, words->bag, options_);
    auto matches = index.query(words->bag, bar, [&](KeyframeId id) {
      return !near.contains(id) && map.keyframes.contains(id);
    });
    candidates = best_groups(map, std::move(matches), options_);
  }
  keep_consistent(map, candidates);
  if (candidates.size() > static_cast<std::size_t>(options_.most))
    candidates.resize(static_cast<std::size_t>(options_.most));
  mark_other_islands(map, query, candidates);
  return candidates;
}

// Leaves those whose surroundings meet those of candidates of the queries before.
void LoopCandidates::keep_consistent(const Map& map, std::vector<LoopCandidate>& candidates) {
  if (options_.consistency <= 0) return;
  std::vector<Group> groups;
  std::vector<LoopCandidate> kept;
  for (const LoopCandidate& candidate : candidates) {
    Group group{{candidate.keyframe}, 0};
    for (const Covisible& c : map.keyframes.at(candidate.keyframe).covisible)
      group.keyframes.insert(c.keyframe);
    for (const Group& former : former_) {
      const bool meets = std::any_of(group.keyframes.begin(), group.keyframes.end(),
                                     [&](KeyframeId id) { return former.keyframes.contains(id); });
      if (meets) group.in_a_row = std::max(group.in_a_row, former.in_a_row + 1);
    }
    if (group.in_a_row >= options_.consistency) kept.push_back(candidate);
    groups.push_back(std::move(group));
  }
  former_ = std::move(groups);
  candidates = std::move(kept);
}

}  // namespace cairn
