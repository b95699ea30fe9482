// Which keyframes may show the place that a new one shows, though nothing in the map says so yet.
//
// After Galvez-Lopez and Tardos 2012, "Bags of binary words for fast place recognition in image
// sequences" (islands of similar images, temporal consistency), and Mur-Artal et al. 2015,
// "ORB-SLAM", section VII-A (covisibility instead of time; the least score of the query's own
// neighbours as the bar). What comes out is a guess by looks alone: server/verify decides.
#pragma once

#include <unordered_set>
#include <vector>

#include "server/map/map.h"
#include "server/place/place_index.h"

namespace cairn {

struct CandidateOptions {
  // Keyframes that share that many landmarks with the query, and what shares that many with those,
  // are near by anyway: a loop with them would correct nothing.
  int near_shared = 15;
  // A place must look at least like this share of what the query's covisible neighbours do, the
  // least similar of the best `bar_neighbours` of them. Views of the same place from elsewhere
  // score less than neighbours in time: at 0.8 a tenth of the revisits is missed that 0.6 finds,
  // for a quarter less candidates.
  double bar_share = 0.6;
  int bar_neighbours = 5;
  // A keyframe without neighbours has no bar of its own; and nobody's bar is lower.
  double least_score = 0.01;
  // Each match gathers the scores of that many of its best covisible keyframes; groups with less
  // than `group_share` of the best one's sum are left out.
  int group_neighbours = 10;
  double group_share = 0.75;
  // How many queries in a row, up to this one and without it, must have had a candidate from the
  // same part of the map. 0: none; a short revisit by a fast client is not missed, and whatever is
  // no loop is left to the verification.
  int consistency = 0;
  int most = 3;  // candidates given back; each costs a verification
};

struct LoopCandidate {
  KeyframeId keyframe;
  double score = 0;           // of this keyframe
  double group_score = 0;     // of its group, by which candidates are ordered
  bool other_island = false;  // nothing in the map connects it with the query
};

// For a view that is not in the map: what looks like it, grouped as above, best first; at most
// options.most. Keyframes of the index that the map does not have are passed over.
std::vector<LoopCandidate> find_candidates(const Map& map, const PlaceIndex& index,
                                           const BagOfWords& view, const CandidateOptions& options);

// Keeps what the consistency of one client's queries needs: one object a client, one thread at a
// time.
class LoopCandidates {
 public:
  explicit LoopCandidates(const CandidateOptions& options = {}) : options_(options) {}

  // `query` must be in the map and in the index, else there are none; keyframes of the index that
  // the map does not have are passed over. To be called for the client's keyframes in order. Best
  // candidate first.
  std::vector<LoopCandidate> find(const Map& map, const PlaceIndex& index, KeyframeId query);

 private:
  // Where a query's candidate lay, and for how many queries in a row there had been one.
  struct Group {
    std::unordered_set<KeyframeId> keyframes;
    int in_a_row = 0;
  };
  void keep_consistent(const Map& map, std::vector<LoopCandidate>& candidates);

  CandidateOptions options_;
  std::vector<Group> former_;  // of the last query
};

}  // namespace cairn
