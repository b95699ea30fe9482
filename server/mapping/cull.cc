#include "server/mapping/cull.h"

#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

namespace cairn {
namespace {

bool fails_trial(const Landmark& landmark, bool mono, std::uint32_t age, const CullOptions& o) {
  // Sightings stopped counting when it first passed, perhaps long before its present reference.
  if (landmark.observations.size() >= o.proven) return false;
  if (landmark.found < o.min_found_share * landmark.visible) return true;
  return age >= o.grace &&
         landmark.observations.size() < (mono ? o.min_observations_mono : o.min_observations);
}

// Depth of a landmark in a keyframe is taken from the measurement: it decides what the keyframe was
// good for. Monocular keyframes take all.
bool is_near(const KeyframeNode& node, std::size_t feature) {
  const Rig& rig = node.rig();
  if (rig.sensor == Sensor::kMono) return true;
  const Feature& f = node.features().points[feature];
  return f.has_depth() && rig.camera.depth(f.disparity) <= rig.max_depth;
}

// How many keyframes show much of what this one shows.
std::size_t crowd_of(const KeyframeNode& node, const CullOptions& options) {
  const auto shown = std::count_if(node.landmarks.begin(), node.landmarks.end(),
                                   [](LandmarkId id) { return id.is_valid(); });
  const double least = options.crowd_overlap * static_cast<double>(shown);
  const auto end = std::find_if(node.covisible.begin(), node.covisible.end(),
                                [&](const Covisible& c) { return c.shared < least; });
  return static_cast<std::size_t>(end - node.covisible.begin());  // strongest first
}

class Redundancy {
 public:
  Redundancy(const Map& map, const CullOptions& options) : map_(map), options_(options) {
    map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
      Newest& newest = newest_[id.epoch];
      newest.sequence = std::max(newest.sequence, id.sequence);
      newest.arrival = std::max(newest.arrival, node.arrival);
    });
  }

  bool may_go(KeyframeId id, const KeyframeNode& node) const {
    // Its place among the others is kept for good when it goes: not before it has been adjusted.
    if (!node.parent.is_valid() || id.sequence >= map_.mapped_of(id.epoch)) return false;
    const Newest& newest = newest_.at(id.epoch);
    return id.sequence + options_.keep_newest <= newest.sequence ||
           newest.arrival + options_.gone_after < map_.revision;
  }

  bool is_redundant(KeyframeId id, const KeyframeNode& node) {
    std::size_t all = 0, near = 0;
    for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
      if (!node.landmarks[f].is_valid()) continue;
      ++all;
      near += is_near(node, f) ? 1 : 0;
    }
    if (all < options_.min_landmarks) return false;
    const bool far_too = near < options_.min_landmarks;
    const double tolerated =
        (1.0 - redundant_share(map_, node, options_)) * static_cast<double>(far_too ? all : near);
    std::size_t alone = 0;  // landmarks that need this keyframe
    for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
      if (!node.landmarks[f].is_valid() || !(far_too || is_near(node, f))) continue;
      if (!seen_enough(node.landmarks[f], id, node.features().points[f].octave)) ++alone;
      if (static_cast<double>(alone) > tolerated) return false;
    }
    return true;
  }

  void remove(KeyframeId id) { removed_.insert(id); }
  bool is_removed(KeyframeId id) const { return removed_.contains(id); }

 private:
  // Looked up once: many landmarks are seen by the same few.
  const std::vector<Feature>& features_of(KeyframeId id) {
    const auto [entry, is_new] = features_.try_emplace(id);
    if (is_new) entry->second = &map_.keyframes.at(id).features().points;
    return *entry->second;
  }

  bool seen_enough(LandmarkId landmark, KeyframeId by, int octave) {
    const auto& observations = map_.landmarks.at(landmark).observations;
    if (std::ssize(observations) <= options_.enough_views) return false;
    int views = 0;
    for (const Observation& o : observations) {
      if (o.keyframe == by || removed_.contains(o.keyframe)) continue;
      // One octave of tolerance: the same distance falls to either side of a border.
      if (features_of(o.keyframe)[o.feature].octave > octave + 1) continue;
      if (++views >= options_.enough_views) return true;
    }
    return false;
  }

  struct Newest {
    std::uint32_t sequence = 0;
    std::uint64_t arrival = 0;
  };
  const Map& map_;
  const CullOptions& options_;
  std::map<std::uint64_t, Newest> newest_;  // by epoch
  std::set<KeyframeId> removed_;
  std::unordered_map<KeyframeId, const std::vector<Feature>*> features_;
};

}  // namespace

double redundant_share(const Map& map, const KeyframeNode& node, const CullOptions& options) {
  constexpr double kFull = 0.2;
  const auto over = [](std::size_t size, std::size_t limit) {
    return static_cast<double>(size) / static_cast<double>(std::max<std::size_t>(limit, 1)) - 1;
  };
  const double map_is_over = std::max(over(map.keyframes.size(), options.keyframe_budget),
                                      over(map.landmarks.size(), options.landmark_budget));
  const double way = std::max(map_is_over / kFull, over(crowd_of(node, options), options.crowd));
  return options.redundant_share +
         std::clamp(way, 0.0, 1.0) * (options.full_share - options.redundant_share);
}

// A keyframe asks before it is mapped itself.
bool is_on_trial(const Map& map, KeyframeId reference, const CullOptions& options) {
  return std::uint64_t{reference.sequence} + options.trial >= map.mapped_of(reference.epoch);
}

std::vector<LandmarkId> landmarks_failing_trial(const Map& map, KeyframeId newest,
                                                const CullOptions& options) {
  std::vector<LandmarkId> failing;
  for (std::uint32_t age = 1; age <= std::min(options.trial, newest.sequence); ++age) {
    const KeyframeId maker{newest.epoch, newest.sequence - age};
    const KeyframeNode* node = map.keyframes.find(maker);
    if (!node) continue;
    const bool mono = node->rig().sensor == Sensor::kMono;
    for (const LandmarkId id : node->landmarks) {
      const Landmark* landmark = map.landmarks.find(id);
      if (landmark && landmark->reference == maker && fails_trial(*landmark, mono, age, options))
        failing.push_back(id);
    }
  }
  return failing;
}

MapDelta cull_keyframes(const Map& map, const std::vector<KeyframeId>& around,
                        const CullOptions& options) {
  MapDelta delta = MapDelta::based_on(map);
  Redundancy redundancy(map, options);
  const auto may_go = [&](KeyframeId id) {
    const KeyframeNode& node = map.keyframes.at(id);
    return std::find(around.begin(), around.end(), id) == around.end() &&
           !redundancy.is_removed(id) && redundancy.may_go(id, node) &&
           redundancy.is_redundant(id, node);
  };
  for (const KeyframeId id : around) {
    const KeyframeNode* centre = map.keyframes.find(id);
    if (!centre) continue;
    const std::size_t count = std::min(options.candidates, centre->covisible.size());
    for (std::size_t i = 0; i < count; ++i) {
      const KeyframeId candidate = centre->covisible[i].keyframe;
      if (!may_go(candidate)) continue;
      redundancy.remove(candidate);
      delta.removed_keyframes.push_back(candidate);
    }
  }
  return delta;
}

}  // namespace cairn
