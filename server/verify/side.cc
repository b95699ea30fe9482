#include "server/verify/side.h"

namespace cairn {

Sight Side::sight(const SideLandmark& own, const Eigen::Vector3d& point_in_other,
                  double slack) const {
  const SideView& view = views[own.view];
  return {point_in_other, *view.node->keyframe, feature_of(own), view.camera_from_primary, slack};
}

std::vector<KeyframeId> group_of(const Map& map, KeyframeId primary, int covisibles,
                                 int min_shared) {
  std::vector<KeyframeId> group{primary};
  for (const Covisible& c : map.keyframes.at(primary).covisible) {
    if (static_cast<int>(group.size()) > covisibles || c.shared < min_shared) break;
    group.push_back(c.keyframe);
  }
  return group;
}

Side make_side(const Map& map, const std::vector<KeyframeId>& group,
               const std::unordered_set<LandmarkId>& without) {
  Side side;
  const Rigid3 primary_from_map = map.keyframes.at(group.front()).map_from_camera.inverse();
  for (const KeyframeId id : group) {
    const KeyframeNode& node = map.keyframes.at(id);
    const Rigid3 primary_from_camera = primary_from_map * node.map_from_camera;
    const auto view = static_cast<std::uint16_t>(side.views.size());
    side.views.push_back(
        {&node, primary_from_camera.inverse(), FeatureGrid(node.features(), node.rig().camera)});
    for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
      const LandmarkId l = node.landmarks[f];
      if (!l.is_valid() || without.contains(l)) continue;
      const Landmark* landmark = map.landmarks.find(l);
      if (!landmark || !landmark->position.allFinite()) continue;
      if (!side.index.emplace(l, static_cast<int>(side.landmarks.size())).second) continue;
      side.landmarks.push_back({landmark, primary_from_map * landmark->position,
                                primary_from_map.rotation * landmark->normal, view,
                                static_cast<std::uint16_t>(f)});
    }
  }
  return side;
}

}  // namespace cairn
