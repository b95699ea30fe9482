#include <limits>

#include "common/model/measurement_noise.h"
#include "server/map/apply.h"
#include "server/map/map_editor.h"
#include "server/map/refresh.h"

namespace cairn {
namespace {

// The pose on arrival comes from the client's tracking and is not refined yet: twice the standard
// deviations of what a refined pose would be held to.
constexpr double kArrivalSlack = 4.0;

bool fits(const KeyframeNode& node, std::uint16_t feature, const Eigen::Vector3d& point) {
  const bool depth = node.features().points[feature].has_depth();
  return reprojection_chi2(node, feature, point) <=
         kArrivalSlack * (depth ? kChi2Depth : kChi2Pixel);
}

std::optional<Rigid3> pose_by_odometry(const Map& map, const Keyframe& keyframe) {
  const KeyframeNode* before = nullptr;
  map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
    if (id.epoch != keyframe.id.epoch || id.sequence > keyframe.id.sequence) return;
    if (!before || before->keyframe->id < id) before = &node;
  });
  if (!before) return std::nullopt;
  return before->map_from_camera * before->keyframe->odom_from_camera.inverse() *
         keyframe.odom_from_camera;
}

Rigid3 pose_on_arrival(const Map& map, const Keyframe& keyframe) {
  if (keyframe.reference.is_valid())
    if (const auto map_from_reference = map.pose_of(keyframe.reference))
      return *map_from_reference * keyframe.reference_from_camera;
  if (map.keyframes.empty() && keyframe.id.sequence == 0) return {};
  return pose_by_odometry(map, keyframe).value_or(keyframe.odom_from_camera);
}

// The keyframe in the map that holds the place of `id`: itself or what it was removed in favour of.
KeyframeId present(const Map& map, KeyframeId id) {
  while (const FormerKeyframe* former = map.removed_keyframes.find(id)) id = former->anchor;
  return id;
}

class Association {
 public:
  Association(Map& map, MapEditor& editor, KeyframeId id) : map_(map), editor_(editor), id_(id) {}

  void take(const LandmarkMatch& match, KeyframeSummary& summary) {
    if (match.feature >= node(id_).features().size()) {
      ++summary.rejected;
    } else if (match.landmark == LandmarkId::from_feature(id_, match.feature)) {
      ++(make_from_depth({id_, match.feature}) ? summary.created : summary.rejected);
    } else {
      const bool made = make_if_missing(match);
      const LandmarkId landmark = resolve(match.landmark);
      if (made) ++summary.created;
      ++(accept(landmark, match.feature) ? summary.accepted : summary.rejected);
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
        maker.map_from_camera * camera.unproject(f.pixel(), camera.depth(f.disparity));
    return point.allFinite() &&
           editor_.insert_landmark(LandmarkId::from_feature(at.keyframe, at.feature), point, at);
  }

  // Makes the landmark that a match names after a feature of an earlier keyframe, if that feature
  // shows none yet and the landmark would be seen where the match says.
  bool make_if_missing(const LandmarkMatch& match) {
    if (resolve(match.landmark).is_valid() || match.landmark.origin == LandmarkId::kServer)
      return false;
    const KeyframeId creator = match.landmark.creator();
    const std::uint16_t feature = match.landmark.creator_feature();
    const KeyframeNode* maker = map_.keyframes.find(creator);
    if (!maker || creator == id_ || feature >= maker->features().size()) return false;
    const Feature& f = maker->features().points[feature];
    if (!f.has_depth()) return false;
    const PinholeCamera& camera = maker->rig().camera;
    const Eigen::Vector3d point =
        maker->map_from_camera * camera.unproject(f.pixel(), camera.depth(f.disparity));
    return fits(node(id_), match.feature, point) && make_from_depth({creator, feature});
  }

  Map& map_;
  MapEditor& editor_;
  KeyframeId id_;
};

}  // namespace

double reprojection_chi2(const KeyframeNode& node, std::uint16_t feature,
                         const Eigen::Vector3d& point_in_map) {
  const Eigen::Vector3d p = node.map_from_camera.inverse() * point_in_map;
  if (!(p.z() > 0)) return std::numeric_limits<double>::infinity();
  const PinholeCamera& camera = node.rig().camera;
  const Feature& f = node.features().points[feature];
  const MeasurementSigma sigma = measurement_sigma(*node.keyframe, f);
  double chi2 = ((camera.project(p) - f.pixel()) / sigma.pixel).squaredNorm();
  if (f.has_depth()) {
    const double error = (camera.disparity(p.z()) - f.disparity) / sigma.disparity;
    chi2 += error * error;
  }
  return chi2;
}

KeyframeSummary apply_keyframe(Map& map, KeyframePtr keyframe) {
  KeyframeSummary summary;
  const KeyframeId id = keyframe->id;
  if (map.keyframes.contains(id) || map.removed_keyframes.contains(id)) return summary;

  const Rigid3 map_from_camera = pose_on_arrival(map, *keyframe);
  MapEditor editor(map);
  editor.insert_keyframe(keyframe, map_from_camera);
  Association association(map, editor, id);
  for (const LandmarkMatch& match : keyframe->matches) association.take(match, summary);
  editor.join_tree(id, present(map, keyframe->reference));
  forget_former(map);
  summary.inserted = true;
  return summary;
}

void refresh_landmark(const Map& map, Landmark& landmark) {
  refresh_descriptor(map, landmark);
  refresh_geometry(map, landmark);
}

}  // namespace cairn
