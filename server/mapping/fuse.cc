#include "server/mapping/fuse.h"

#include <algorithm>
#include <set>
#include <tuple>

#include "server/mapping/neighbours.h"

namespace cairn {
namespace {

// Collects findings, each once: the search in both directions finds many pairs twice.
class Findings {
 public:
  Findings(const Map& map, MapDelta& delta) : map_(map), delta_(delta) {}

  void add(const Landmark& landmark, const KeyframeView& view, std::uint16_t feature) {
    const LandmarkId shown = view.node->landmarks[feature];
    if (!shown.is_valid()) {
      const Observation observation{view.id(), feature};
      if (observations_.insert({observation, landmark.id}).second)
        delta_.new_observations.push_back({landmark.id, observation});
    } else if (shown != landmark.id) {
      add_fusion(landmark, map_.landmarks.at(shown));
    }
  }

 private:
  void add_fusion(const Landmark& a, const Landmark& b) {
    const auto rank = [](const Landmark& l) {
      return std::make_tuple(-std::ssize(l.observations), l.id);
    };
    const bool keep_a = rank(a) < rank(b);
    const MapDelta::Fusion fusion{keep_a ? b.id : a.id, keep_a ? a.id : b.id};
    if (fusions_.insert({fusion.from, fusion.into}).second) delta_.fusions.push_back(fusion);
  }

  const Map& map_;
  MapDelta& delta_;
  std::set<std::pair<Observation, LandmarkId>> observations_;
  std::set<std::pair<LandmarkId, LandmarkId>> fusions_;
};

bool sees(const Landmark& landmark, KeyframeId keyframe) {
  return std::any_of(landmark.observations.begin(), landmark.observations.end(),
                     [&](const Observation& o) { return o.keyframe == keyframe; });
}

void search(const std::vector<const Landmark*>& landmarks, const KeyframeView& view,
            const FuseOptions& options, Findings& findings) {
  for (const Landmark* landmark : landmarks) {
    const auto projection = view.project(*landmark);
    if (!projection || sees(*landmark, view.id())) continue;
    if (const auto feature =
            view.find(*landmark, *projection, options.radius, options.max_distance))
      findings.add(*landmark, view, *feature);
  }
}

std::vector<const Landmark*> pointers(const Map& map, const std::vector<KeyframeId>& keyframes) {
  std::vector<const Landmark*> all;
  for (const LandmarkId id : landmarks_of(map, keyframes)) all.push_back(map.landmarks.find(id));
  return all;
}

}  // namespace

MapDelta fuse(const Map& map, KeyframeId id, GridCache& grids, const FuseOptions& options,
              FuseDirection direction) {
  MapDelta delta = MapDelta::based_on(map);
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return delta;
  const std::vector<KeyframeId> others = neighbourhood(map, id, options.first, options.limit);
  Findings findings(map, delta);
  if (direction != FuseDirection::kInto) {
    const std::vector<const Landmark*> own = pointers(map, {id});
    for (const KeyframeId other : others)
      search(own, KeyframeView(map.keyframes.at(other), grids), options, findings);
  }
  if (direction != FuseDirection::kFrom)
    search(pointers(map, others), KeyframeView(*node, grids), options, findings);
  return delta;
}

}  // namespace cairn
