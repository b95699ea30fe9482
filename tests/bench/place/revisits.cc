#include "tests/bench/place/revisits.h"

#include <algorithm>
#include <utility>

namespace cairn::bench {
namespace {

using Place = Scenery::Place;

// The w-th walk is that of the client with epoch w + 1.
Place place_of(KeyframeId id) {
  return {id.epoch - 1, id.sequence};
}

// A map as tracking and mapping would make it of the views so far: those close in time share as
// many landmarks as they overlap.
class Mapper {
 public:
  explicit Mapper(const Scenery& scenery) : scenery_(scenery) {}

  void add(KeyframeId id) {
    KeyframeNode node;
    for (std::uint32_t sequence = id.sequence;
         sequence > 0 && seconds(id, {id.epoch, sequence - 1}) <= scenery_.apart_s(); --sequence) {
      const KeyframeId other{id.epoch, sequence - 1};
      const int shared = static_cast<int>(300 * overlap_of(id, other));
      if (shared > 0) node.covisible.edit().push_back({other, shared});
    }
    for (const Covisible& c : node.covisible) link(c.keyframe, {id, c.shared});
    auto& list = node.covisible.edit();
    std::stable_sort(list.begin(), list.end(), stronger);
    if (id.sequence > 0) node.parent = {id.epoch, id.sequence - 1};
    map_.keyframes.insert(id, std::move(node));
    known_.push_back(id);
  }
  const Map& map() const { return map_; }

  // An earlier keyframe that is not near by truly shows what this one does.
  bool is_revisit(KeyframeId id) const {
    return std::any_of(known_.begin(), known_.end(), [&](KeyframeId other) {
      return is_apart(other, id) && overlap_of(other, id) >= kMustFind;
    });
  }
  bool is_right(KeyframeId a, KeyframeId b) const { return overlap_of(a, b) >= kIsRight; }
  bool is_apart(KeyframeId a, KeyframeId b) const {
    return a.epoch != b.epoch || seconds(a, b) > 2 * scenery_.apart_s();
  }

 private:
  static bool stronger(const Covisible& a, const Covisible& b) { return a.shared > b.shared; }
  double seconds(KeyframeId a, KeyframeId b) const {
    return std::abs(scenery_.view(place_of(a)).seconds - scenery_.view(place_of(b)).seconds);
  }
  double overlap_of(KeyframeId a, KeyframeId b) const {
    return scenery_.overlap_of(place_of(a), place_of(b));
  }
  void link(KeyframeId id, const Covisible& to) {
    auto& list = map_.keyframes.edit(id)->covisible.edit();
    list.insert(std::upper_bound(list.begin(), list.end(), to, stronger), to);
  }

  const Scenery& scenery_;
  Map map_;
  std::vector<KeyframeId> known_;
};

void score(const Mapper& mapper, KeyframeId query, const std::vector<LoopCandidate>& candidates,
           const std::vector<PlaceMatch>& by_looks, RevisitScore& total) {
  const auto is_right = [&](KeyframeId id) { return mapper.is_right(id, query); };
  ++total.views;
  int right = 0;
  for (const LoopCandidate& c : candidates) right += is_right(c.keyframe);
  total.candidates += static_cast<int>(candidates.size());
  total.right += right;
  if (!mapper.is_revisit(query)) return;
  ++total.revisits;
  total.any_right += right > 0;
  total.first_right += !candidates.empty() && is_right(candidates.front().keyframe);
  total.places += !by_looks.empty() && is_right(by_looks.front().keyframe);
}

}  // namespace

Scenery::Scenery(std::vector<const Walk*> walks, double apart_s)
    : walks_(std::move(walks)), apart_s_(apart_s) {
  std::vector<std::pair<const Walk*, const View*>> all;
  for (const Walk* walk : walks_) {
    first_.push_back(all.size());
    for (const View& view : walk->views) all.emplace_back(walk, &view);
  }
  size_ = all.size();
  overlaps_.assign(size_ * size_, 1.0f);
  for (std::size_t i = 0; i < size_; ++i)
    for (std::size_t j = 0; j < i; ++j)
      overlaps_[i * size_ + j] = overlaps_[j * size_ + i] =
          static_cast<float>(overlap(all[i].first->camera, *all[i].second, *all[j].second));
}

double Scenery::overlap_of(Place a, Place b) const {
  return overlaps_[number(a) * size_ + number(b)];
}

RevisitScore score_revisits(const Vocabulary& vocabulary, const Scenery& scenery,
                            const CandidateOptions& options, std::size_t beam) {
  RevisitScore total;
  Mapper mapper(scenery);
  PlaceIndex index;
  for (std::size_t w = 0; w < scenery.walks().size(); ++w) {
    LoopCandidates loops(options);
    for (std::size_t v = 0; v < scenery.walks()[w]->views.size(); ++v) {
      const KeyframeId id{w + 1, static_cast<std::uint32_t>(v)};
      mapper.add(id);
      Words words = vocabulary.words(scenery.view({w, v}).descriptors, beam);
      const auto by_looks =
          index.query(words.bag, 0, [&](KeyframeId other) { return mapper.is_apart(other, id); });
      index.add(id, std::move(words));
      score(mapper, id, loops.find(mapper.map(), index, id), by_looks, total);
    }
  }
  return total;
}

}  // namespace cairn::bench
