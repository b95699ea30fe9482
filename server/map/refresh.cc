#include "server/map/refresh.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

constexpr std::size_t kMaxCompared = 16;

}  // namespace

void refresh_descriptor(const Map& map, Landmark& landmark) {
  std::array<const Descriptor*, kMaxCompared> observed;
  std::size_t count = 0;
  for (auto o = landmark.observations.rbegin();
       o != landmark.observations.rend() && count < kMaxCompared; ++o)
    observed[count++] = &map.keyframes.at(o->keyframe).features().descriptors[o->feature];
  if (count == 0) return;

  std::array<std::array<int, kMaxCompared>, kMaxCompared> distance{};
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < i; ++j)
      distance[i][j] = distance[j][i] = hamming_distance(*observed[i], *observed[j]);

  std::size_t best = 0;
  int best_median = std::numeric_limits<int>::max();
  for (std::size_t i = 0; i < count; ++i) {
    auto& row = distance[i];
    const auto middle = row.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(row.begin(), middle, row.begin() + static_cast<std::ptrdiff_t>(count));
    if (*middle < best_median) {
      best_median = *middle;
      best = i;
    }
  }
  landmark.descriptor = *observed[best];
}

void refresh_geometry(const Map& map, Landmark& landmark) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Observation& o : landmark.observations) {
    const KeyframeNode& node = map.keyframes.at(o.keyframe);
    const Eigen::Vector3d to_camera = node.map_from_camera.origin() - landmark.position;
    sum += to_camera.normalized();
    if (o.keyframe != landmark.reference) continue;
    const ScalePyramid& pyramid = node.rig().pyramid;
    const double distance = to_camera.norm();
    const double far = distance * pyramid.scale(node.features().points[o.feature].octave);
    landmark.max_distance = static_cast<float>(far);
    landmark.min_distance = static_cast<float>(far / pyramid.scale(pyramid.levels - 1));
  }
  const double length = sum.norm();
  landmark.normal = length > 0 ? Eigen::Vector3d(sum / length) : Eigen::Vector3d::Zero();
}

int predicted_octave(const Landmark& landmark, double distance, const ScalePyramid& pyramid) {
  const double octave = std::ceil(
      std::log(landmark.max_distance / distance) / std::log(double{pyramid.factor}) - 1e-6);
  return std::clamp(static_cast<int>(octave), 0, pyramid.levels - 1);
}

}  // namespace cairn
