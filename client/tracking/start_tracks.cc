#include "client/tracking/start_tracks.h"

#include <algorithm>

#include "common/feature/hamming.h"
#include "common/feature/matching.h"

namespace cairn {
namespace {

constexpr float kRadius = 60;  // pixels around where the last motion leads; 40 degrees a second
constexpr float kRatio = 0.9f;

float median(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Of several tracks that want one feature, the one that looks most like it stays.
void keep_best_for_each(std::vector<FeatureMatch>& matches, std::size_t features) {
  std::vector<int> least(features, kLooseDistance + 1);
  for (const FeatureMatch& m : matches) least[m.b] = std::min(least[m.b], int{m.distance});
  std::erase_if(matches, [&](const FeatureMatch& m) {
    if (m.distance > least[m.b]) return true;
    least[m.b] = -1;  // of equals the first
    return false;
  });
}

}  // namespace

StartTracks::StartTracks(Features reference) : reference_(std::move(reference)) {
  for (std::size_t i = 0; i < reference_.size(); ++i)
    sights_.push_back({reference_.points[i].x, reference_.points[i].y, reference_.descriptors[i]});
}

std::vector<StartTrack> StartTracks::follow(const Features& features, const FeatureGrid& grid) {
  std::vector<FeatureMatch> matches;
  std::vector<std::uint16_t> nearby;
  for (std::size_t i = 0; i < sights_.size(); ++i) {
    const Sight& sight = sights_[i];
    const int octave = reference_.points[i].octave;
    nearby.clear();
    grid.search(sight.x + flow_x_, sight.y + flow_y_, kRadius, octave - 1, octave + 1, nearby);
    const Nearest first = nearest(reference_.descriptors[i], nearby, features.descriptors);
    const Nearest latest = nearest(sight.descriptor, nearby, features.descriptors);
    const Nearest& better = latest.distance < first.distance ? latest : first;
    if (!better.accept(kStrictDistance, kRatio)) continue;
    matches.push_back({static_cast<std::uint16_t>(i), static_cast<std::uint16_t>(better.index),
                       static_cast<std::uint16_t>(better.distance)});
  }
  keep_best_for_each(matches, features.size());
  keep_consistent_turns(reference_, features, matches);

  return take(matches, features);
}

std::vector<StartTrack> StartTracks::take(const std::vector<FeatureMatch>& matches,
                                          const Features& features) {
  std::vector<float> flow_x, flow_y;
  for (const FeatureMatch& m : matches) {
    flow_x.push_back(features.points[m.b].x - sights_[m.a].x);
    flow_y.push_back(features.points[m.b].y - sights_[m.a].y);
  }
  flow_x_ = median(flow_x);
  flow_y_ = median(flow_y);
  // What was missed has moved with the others.
  for (Sight& sight : sights_) {
    sight.x += flow_x_;
    sight.y += flow_y_;
  }
  std::vector<StartTrack> tracks;
  for (const FeatureMatch& m : matches) {
    const Feature& f = features.points[m.b];
    sights_[m.a] = {f.x, f.y, features.descriptors[m.b]};
    tracks.push_back({m.a, m.b});
  }
  return tracks;
}

}  // namespace cairn
