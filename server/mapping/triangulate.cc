#include "server/mapping/triangulate.h"

#include <algorithm>
#include <set>

#include "server/map/apply.h"
#include "server/mapping/epipolar_match.h"
#include "server/mapping/neighbours.h"
#include "server/mapping/two_view.h"

namespace cairn {
namespace {

std::vector<std::uint16_t> free_features(const KeyframeNode& node) {
  std::vector<std::uint16_t> free;
  for (std::size_t f = 0; f < node.landmarks.size(); ++f)
    if (!node.landmarks[f].is_valid()) free.push_back(static_cast<std::uint16_t>(f));
  return free;
}

bool reprojects(const KeyframeNode& node, std::uint16_t f, const Eigen::Vector3d& point) {
  const bool depth = node.features().points[f].has_depth();
  return reprojection_chi2(node, f, point) <= (depth ? kChi2Depth : kChi2Pixel);
}

// A feature's scale times its distance is the same in every view.
bool scales_agree(const KeyframeView& a, const KeyframeView& b, const FeaturePair& pair,
                  const Eigen::Vector3d& point, double tolerance) {
  const double reach_a =
      (a.node->map_from_camera.origin() - point).norm() * a.scale(a.feature(pair.first).octave);
  const double reach_b =
      (b.node->map_from_camera.origin() - point).norm() * b.scale(b.feature(pair.second).octave);
  return reach_a < tolerance * reach_b && reach_b < tolerance * reach_a;
}

std::optional<Eigen::Vector3d> point_of(const KeyframeView& a, const KeyframeView& b,
                                        const FeaturePair& pair,
                                        const TriangulateOptions& options) {
  const auto point = triangulate_two_views({a.node, &a.camera_from_map, &a.feature(pair.first)},
                                           {b.node, &b.camera_from_map, &b.feature(pair.second)});
  if (!point || point->relative_sigma > options.max_relative_sigma) return std::nullopt;
  const Eigen::Vector3d& position = point->position;
  if (!reprojects(*a.node, pair.first, position) || !reprojects(*b.node, pair.second, position) ||
      !scales_agree(a, b, pair, position, options.scale_tolerance))
    return std::nullopt;
  return position;
}

}  // namespace

MapDelta triangulate(const Map& map, KeyframeId id, GridCache& grids,
                     const TriangulateOptions& options) {
  MapDelta delta = MapDelta::based_on(map);
  const KeyframeNode* node = map.keyframes.find(id);
  if (!node) return delta;
  const KeyframeView view(*node, grids);
  std::vector<std::uint16_t> free = free_features(*node);
  for (const KeyframeId other_id : best_covisible(map, id, options.neighbours)) {
    if (free.empty()) break;
    const KeyframeView other(map.keyframes.at(other_id), grids);
    std::set<std::uint16_t> used;
    for (const FeaturePair& pair :
         match_on_epipolar_lines(view, free, other, free_features(*other.node), options)) {
      const auto point = point_of(view, other, pair, options);
      if (!point) continue;
      delta.new_landmarks.push_back({*point, {{id, pair.first}, {other_id, pair.second}}});
      used.insert(pair.first);
    }
    std::erase_if(free, [&](std::uint16_t f) { return used.contains(f); });
  }
  return delta;
}

}  // namespace cairn
