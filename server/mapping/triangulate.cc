#include "server/mapping/triangulate.h"

#include <algorithm>
#include <set>

#include "server/mapping/neighbours.h"

namespace cairn {
namespace {

std::vector<std::uint16_t> free_features(const KeyframeNode& node) {
  std::vector<std::uint16_t> free;
  for (std::size_t f = 0; f < node.landmarks.size(); ++f)
    if (!node.landmarks[f].is_valid()) free.push_back(static_cast<std::uint16_t>(f));
  return free;
}

View view_of(const KeyframeNode& node) {
  return View::of(*node.keyframe, node.map_from_camera);
}

}  // namespace

MapDelta triangulate(const Map& map, KeyframeId id, const TriangulateOptions& options) {
  MapDelta delta = MapDelta::based_on(map);
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return delta;
  const View view = view_of(*node);
  const std::size_t neighbours =
      node->rig().sensor == Sensor::kMono ? options.neighbours_mono : options.neighbours;
  std::vector<std::uint16_t> free = free_features(*node);
  for (const KeyframeId other_id : best_covisible(map, id, neighbours)) {
    if (free.empty()) break;
    const KeyframeNode& other = map.keyframes.at(other_id);
    std::set<std::uint16_t> used;
    for (const PairPoint& made :
         triangulate_pairs(view, free, view_of(other), free_features(other), options.pair)) {
      delta.new_landmarks.push_back({made.position, {{id, made.a}, {other_id, made.b}}});
      used.insert(made.a);
    }
    std::erase_if(free, [&](std::uint16_t f) { return used.contains(f); });
  }
  return delta;
}

}  // namespace cairn
