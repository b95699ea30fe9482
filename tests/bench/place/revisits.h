// How well revisits are found: candidates of every view of a walk, told against what it truly sees.
#pragma once

#include <vector>

#include "server/place/loop_candidates.h"
#include "server/place/vocabulary.h"
#include "tests/bench/place/walks.h"

namespace cairn::bench {

// An earlier view with at least this overlap is a revisit that should be found ...
inline constexpr double kMustFind = 0.4;
// ... and a candidate with at least this overlap is a right one.
inline constexpr double kIsRight = 0.25;

struct RevisitScore {
  int views = 0;
  int revisits = 0;     // views that show again what a view far enough away in time showed
  int first_right = 0;  // revisits whose first candidate was right
  int any_right = 0;    // revisits with a right one among the candidates
  int candidates = 0, right = 0;  // of all views
  int places = 0;  // looked up by looks alone, without any bar: the best match was right
};

// Walks through one scene, one after the other, each an island of its own; and the overlap of all
// their views, which takes a while to find and stays the same for every vocabulary.
class Scenery {
 public:
  // Views up to `apart_s` seconds apart are linked as tracking would link them; beyond twice that
  // one may be a revisit of the other.
  explicit Scenery(std::vector<const Walk*> walks, double apart_s = 4.0);

  // A view by its walk, from 0, and its place in it.
  struct Place {
    std::size_t walk = 0, view = 0;
  };
  const std::vector<const Walk*>& walks() const { return walks_; }
  double apart_s() const { return apart_s_; }
  const View& view(Place place) const { return walks_[place.walk]->views[place.view]; }
  double overlap_of(Place a, Place b) const;

 private:
  std::size_t number(Place place) const { return first_[place.walk] + place.view; }

  std::vector<const Walk*> walks_;
  double apart_s_;
  std::vector<std::size_t> first_;  // number of each walk's first view
  std::size_t size_ = 0;
  std::vector<float> overlaps_;  // size_ x size_
};

RevisitScore score_revisits(const Vocabulary& vocabulary, const Scenery& scenery,
                            const CandidateOptions& options, std::size_t beam = Vocabulary::kBeam);

}  // namespace cairn::bench
