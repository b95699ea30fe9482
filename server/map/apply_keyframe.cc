#include "common/feature/two_view.h"
#include "server/map/apply.h"
#include "server/map/map_editor.h"
#include "server/map/refresh.h"

namespace cairn {
namespace {

// The pose on arrival comes from the client's tracking and is not refined yet: twice the standard
// deviations of what a refined pose would be held to.
constexpr double kArrivalSlack = 4.0;

View view_of(const KeyframeNode& node) {
  return View::of(*node.keyframe, node.map_from_camera);
}

bool fits(const KeyframeNode& node, std::uint16_t feature, const Eigen::Vector3d& point) {
  const bool depth = node.features().points[feature].has_depth();
  return reprojection_chi2(node, feature, point) <=
         kArrivalSlack * (depth ? kChi2Depth : kChi2Pixel);
}

std::optional<Sim3> pose_by_odometry(const Map& map, const Keyframe& keyframe) {
  const KeyframeNode* before = nullptr;
  map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
    if (id.epoch != keyframe.id.epoch || id.sequence > keyframe.id.sequence) return;
    if (!before || before->keyframe->id < id) before = &node;
  });
  if (!before) return std::nullopt;
  return before->scaled_pose() * before->keyframe->odom_from_camera.inverse() *
         keyframe.odom_from_camera;
}

// Each keyframe may change the scale by what the wire allows; a chain of them must not leave what
// numbers can hold, and the wire and the map file with them.
bool is_plausible(const Sim3& pose) {
  constexpr double kMostScale = 1e6, kFarthest = 1e7;
  return pose.rotation.coeffs().allFinite() && pose.translation.norm() <= kFarthest &&
         pose.scale >= 1 / kMostScale && pose.scale <= kMostScale;
}

Sim3 pose_on_arrival(const Map& map, const Keyframe& keyframe) {
  if (keyframe.reference.is_valid())
    if (const auto map_from_reference = map.scaled_pose_of(keyframe.reference)) {
      Sim3 pose = *map_from_reference * keyframe.reference_from_camera;
      if (is_plausible(pose)) return pose;
    }
  if (map.keyframes.empty() && keyframe.id.sequence == 0) return {};
  const auto pose = pose_by_odometry(map, keyframe);
  return pose && is_plausible(*pose) ? *pose : keyframe.odom_from_camera;
}

class Association {
 public:
  Association(Map& map, MapEditor& editor, KeyframeId id) : map_(map), editor_(editor), id_(id) {}

  void take(const LandmarkMatch& match, KeyframeSummary& summary) {
    if (match.feature >= node(id_).features().size()) {
      ++summary.rejected;
    } else if (match.landmark == LandmarkId::from_feature(id_, match.feature)) {
      ++(make_from_depth({id_, match.feature}) ? summary.created : summary.rejected);
    } else if (is_missing(match.landmark) && make_from_two_views(match)) {
      ++summary.created;
    } else {
      if (is_missing(match.landmark) && make_from_creator(match)) ++summary.created;
      ++(accept(resolve(match.landmark), match.feature) ? summary.accepted : summary.rejected);
    }
  }

 private:
  const KeyframeNode& node(KeyframeId id) const { return map_.keyframes.at(id); }

  // The landmark meant by a name: itself, what it was fused into, or what its feature shows now.
  LandmarkId resolve(LandmarkId name) const {
    const LandmarkId landmark = map_.resolve(name);
    if (landmark.is_valid() || name.origin == LandmarkId::kServer) return landmark;
    const KeyframeNode* creator = map_.keyframes.find(name.creator());
    if (!creator || name.creator_feature() >= creator->landmarks.size()) return {};
    return creator->landmarks[name.creator_feature()];
  }

  bool accept(LandmarkId id, std::uint16_t feature) {
    const Landmark* landmark = map_.landmarks.find(id);
    if (!landmark || !fits(node(id_), feature, landmark->position)) return false;
    return editor_.add_observation(id, {id_, feature});
  }

  bool make_from_depth(const Observation& at) {
    const KeyframeNode& maker = node(at.keyframe);
    const Feature& f = maker.features().points[at.feature];
    if (!f.has_depth()) return false;
    const PinholeCamera& camera = maker.rig().camera;
    const Eigen::Vector3d point =
        maker.scaled_pose() * camera.unproject(f.pixel(), camera.depth(f.disparity));
    return point.allFinite() &&
           editor_.insert_landmark(LandmarkId::from_feature(at.keyframe, at.feature), point, at);
  }

  bool is_missing(LandmarkId name) const {
    return name.origin != LandmarkId::kServer && !resolve(name).is_valid();
  }

  // The earlier keyframe and feature that a client's landmark is named after, if the map has them.
  const KeyframeNode* creator_of(LandmarkId name) const {
    const KeyframeNode* creator = map_.keyframes.find(name.creator());
    const bool usable =
        creator && name.creator() != id_ && name.creator_feature() < creator->features().size();
    return usable ? creator : nullptr;
  }

  // Makes the landmark that a match names after a feature of an earlier keyframe, if that feature
  // shows none yet and the landmark would be seen where the match says.
  bool make_from_creator(const LandmarkMatch& match) {
    const KeyframeNode* creator = creator_of(match.landmark);
    if (!creator) return false;
    const std::uint16_t feature = match.landmark.creator_feature();
    const Feature& f = creator->features().points[feature];
    if (!f.has_depth()) return false;
    const PinholeCamera& camera = creator->rig().camera;
    const Eigen::Vector3d point =
        creator->scaled_pose() * camera.unproject(f.pixel(), camera.depth(f.disparity));
    return fits(node(id_), match.feature, point) &&
           make_from_depth({match.landmark.creator(), feature});
  }

  // The same where neither has depth: from both views. The new keyframe is the reference, as with
  // landmarks that the server finds itself.
  bool make_from_two_views(const LandmarkMatch& match) {
    const KeyframeNode* creator = creator_of(match.landmark);
    if (!creator) return false;
    const Observation first{id_, match.feature};
    const Observation second{match.landmark.creator(), match.landmark.creator_feature()};
    const Feature& in_first = node(id_).features().points[first.feature];
    const Feature& in_second = creator->features().points[second.feature];
    if (in_first.has_depth() || in_second.has_depth()) return false;
    const auto point =
        triangulate_two_views(view_of(node(id_)), in_first, view_of(*creator), in_second);
    return point && fits(node(id_), first.feature, point->position) &&
           fits(*creator, second.feature, point->position) &&
           editor_.insert_landmark(match.landmark, point->position, first) &&
           editor_.add_observation(match.landmark, second);
  }

  Map& map_;
  MapEditor& editor_;
  KeyframeId id_;
};

}  // namespace

double reprojection_chi2(const KeyframeNode& node, std::uint16_t feature,
                         const Eigen::Vector3d& point_in_map) {
  return reprojection_chi2(view_of(node), node.features().points[feature], point_in_map);
}

KeyframeSummary apply_keyframe(Map& map, KeyframePtr keyframe) {
  KeyframeSummary summary;
  const KeyframeId id = keyframe->id;
  if (map.keyframes.contains(id) || map.removed_keyframes.contains(id)) return summary;

  const Sim3 map_from_camera = pose_on_arrival(map, *keyframe);
  MapEditor editor(map);
  editor.insert_keyframe(keyframe, map_from_camera);
  Association association(map, editor, id);
  for (const LandmarkMatch& match : keyframe->matches) association.take(match, summary);
  editor.join_tree(id, map.present(keyframe->reference));
  forget_former(map);
  summary.inserted = true;
  return summary;
}

void refresh_landmark(const Map& map, Landmark& landmark) {
  refresh_descriptor(map, landmark);
  refresh_geometry(map, landmark);
}

}  // namespace cairn
