// One of the two places that are compared: a keyframe, its neighbours, and what they know, told in
// the frame of the keyframe's camera (`primary`). Private to server/verify.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "common/feature/feature_grid.h"
#include "server/map/map.h"
#include "server/optimize/relative_pose.h"

namespace cairn {

struct SideView {
  const KeyframeNode* node;  // of the map, which must outlive this
  Rigid3 camera_from_primary;
  FeatureGrid grid;
};

struct SideLandmark {
  const Landmark* landmark;
  Eigen::Vector3d position;  // in primary
  Eigen::Vector3d normal;    // in primary
  // The sight that stands for it: in the primary's own image where it is seen there.
  std::uint16_t view = 0, feature = 0;
};

struct Side {
  std::vector<SideView> views;  // the primary first
  std::vector<SideLandmark> landmarks;
  std::unordered_map<LandmarkId, int> index;  // of landmarks

  const Feature& feature_of(const SideLandmark& l) const {
    return views[l.view].node->features().points[l.feature];
  }
  // A point of the other side, as it should show where this side sees `own`.
  Sight sight(const SideLandmark& own, const Eigen::Vector3d& point_in_other, double slack) const;
};

// The keyframe and up to `covisibles` of its most covisible ones, each with `min_shared` landmarks
// in common with it or more.
std::vector<KeyframeId> group_of(const Map& map, KeyframeId primary, int covisibles,
                                 int min_shared);

// `group` starts with the primary and is in the map; landmarks in `without` are left out.
Side make_side(const Map& map, const std::vector<KeyframeId>& group,
               const std::unordered_set<LandmarkId>& without);

}  // namespace cairn
