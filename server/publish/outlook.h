// What a client sees, and what it is about to see if it goes on as it does.
#pragma once

#include <array>

#include "server/map/map.h"

namespace cairn {

class Outlook {
 public:
  // From its latest keyframe and the one before, which may be null.
  Outlook(const KeyframeNode& latest, const KeyframeNode* before);

  const Eigen::Vector3d& centre() const { return map_from_view_[0].translation; }
  // Whether a point of the map lies in the view of now or of the near future, or not far beside.
  bool shows(const Eigen::Vector3d& point) const;
  // By how many pixels the client could notice that a point has moved: what shows from where it
  // stands, and what of the change in distance shows when it has gone a tenth of that distance to
  // the side.
  double shift_px(const Eigen::Vector3d& from, const Eigen::Vector3d& to) const;

 private:
  bool is_in_view(const Rigid3& view_from_map, const Eigen::Vector3d& point) const;

  PinholeCamera camera_;
  std::array<Rigid3, 2> map_from_view_, view_from_map_;  // now and soon
};

}  // namespace cairn
