#include "client/tracking/provisional.h"

#include <algorithm>

namespace cairn {
namespace {

std::vector<std::uint16_t> unmatched(const TrackedFrame& frame) {
  std::vector<std::uint16_t> free;
  for (std::size_t f = 0; f < frame.features.size(); ++f)
    if (!frame.matches[f].shows_landmark()) free.push_back(static_cast<std::uint16_t>(f));
  return free;
}

std::vector<std::uint16_t> unmatched(const LocalMap& map, const Keyframe& keyframe) {
  const std::vector<LandmarkId> shown = map.landmarks_by_feature(keyframe);
  std::vector<std::uint16_t> free;
  for (std::size_t f = 0; f < shown.size(); ++f)
    if (!shown[f].is_valid()) free.push_back(static_cast<std::uint16_t>(f));
  return free;
}

double median_depth(const TrackedFrame& frame) {
  const Rigid3 camera_from_map = frame.map_from_camera.inverse();
  std::vector<double> depths;
  for (const FeatureMatch& m : frame.matches)
    if (m.shows_landmark()) depths.push_back((camera_from_map * m.position).z());
  if (depths.empty()) return 0;
  const auto middle = depths.begin() + std::ssize(depths) / 2;
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

}  // namespace

std::vector<ProvisionalLandmark> triangulate_provisional(const LocalMap& map,
                                                         const TrackedFrame& frame,
                                                         const ProvisionalOptions& options) {
  std::vector<ProvisionalLandmark> made;
  const View view{frame.rig.get(), &frame.features, frame.map_from_camera.inverse(), frame.noise()};
  const double least_baseline = options.min_baseline * median_depth(frame);
  std::vector<std::uint16_t> free = unmatched(frame);
  std::vector<bool> used(frame.features.size(), false);
  std::size_t compared = 0;
  for (const KeyframePtr& other :
       map.keyframes_sharing(frame.landmarks(), 4 * options.neighbours)) {
    const Rigid3 map_from_other = *map.pose_of(other->id);
    if ((map_from_other.origin() - frame.map_from_camera.origin()).norm() < least_baseline)
      continue;
    for (const PairPoint& p : triangulate_pairs(view, free, View::of(*other, map_from_other),
                                                unmatched(map, *other), options.pair)) {
      made.push_back({p.a, LandmarkId::from_feature(other->id, p.b), p.position});
      used[p.a] = true;
    }
    std::erase_if(free, [&](std::uint16_t f) { return used[f]; });
    if (++compared >= options.neighbours) break;
  }
  return made;
}

}  // namespace cairn
