#include "server/mapping/keyframe_view.h"

#include <algorithm>
#include <cmath>

#include "common/feature/hamming.h"
#include "common/model/measurement_noise.h"
#include "server/map/apply.h"

namespace cairn {
namespace {

constexpr double kMinDepth = 0.05;  // metres; nearer is inside the lens
constexpr double kMinCosine =
    0.5;  // of the angle between a landmark's normal and the line of sight

}  // namespace

std::shared_ptr<const FeatureGrid> GridCache::grid(const Keyframe& keyframe) {
  if (const auto found = entries_.find(keyframe.id); found != entries_.end()) {
    uses_.splice(uses_.begin(), uses_, found->second.use);
    return found->second.grid;
  }
  if (entries_.size() >= capacity_) {
    entries_.erase(uses_.back());
    uses_.pop_back();
  }
  uses_.push_front(keyframe.id);
  auto grid = std::make_shared<const FeatureGrid>(keyframe.features, keyframe.rig->camera);
  entries_[keyframe.id] = {grid, uses_.begin()};
  return grid;
}

std::optional<Eigen::Vector3d> can_show(const KeyframeNode& node, const Rigid3& camera_from_map,
                                        const Landmark& landmark) {
  const Eigen::Vector3d p = camera_from_map * landmark.position;
  if (p.z() < kMinDepth) return std::nullopt;
  const PinholeCamera& c = node.rig().camera;
  const Eigen::Vector2d pixel = c.project(p);
  if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= c.width || pixel.y() >= c.height)
    return std::nullopt;
  const double distance = p.norm();
  if (distance < 0.8 * landmark.min_distance || distance > 1.2 * landmark.max_distance)
    return std::nullopt;
  const Eigen::Vector3d to_camera = node.map_from_camera.origin() - landmark.position;
  if (to_camera.dot(landmark.normal) < kMinCosine * distance) return std::nullopt;
  return p;
}

KeyframeView::KeyframeView(const KeyframeNode& n, GridCache& grids)
    : node(&n),
      camera_from_map(n.map_from_camera.inverse()),
      grid_(grids.grid(*n.keyframe)),
      inverse_log_factor_(1.0 / std::log(double{n.rig().pyramid.factor})) {
  const ScalePyramid& pyramid = n.rig().pyramid;
  for (int octave = 0; octave < pyramid.levels; ++octave) scales_.push_back(pyramid.scale(octave));
}

std::optional<Projection> KeyframeView::project(const Landmark& landmark) const {
  const auto p = can_show(*node, camera_from_map, landmark);
  if (!p) return std::nullopt;
  const double octave =
      std::ceil(std::log(landmark.max_distance / p->norm()) * inverse_log_factor_);
  return Projection{
      .pixel = camera().project(*p),
      .disparity = camera().disparity(p->z()),
      .octave = std::clamp(static_cast<int>(octave), 0, static_cast<int>(scales_.size()) - 1)};
}

bool KeyframeView::fits(const Projection& projection, const Feature& f) const {
  const MeasurementSigma sigma = measurement_sigma(*node->keyframe, f);
  const double chi2 = ((projection.pixel - f.pixel()) / sigma.pixel).squaredNorm();
  if (!f.has_depth()) return chi2 <= kChi2Pixel;
  const double error = (projection.disparity - f.disparity) / sigma.disparity;
  return chi2 + error * error <= kChi2Depth;
}

std::optional<std::uint16_t> KeyframeView::find(const Landmark& landmark,
                                                const Projection& projection, double radius,
                                                int max_distance) const {
  thread_local std::vector<std::uint16_t> near;  // kept for its memory
  near.clear();
  grid_->search(static_cast<float>(projection.pixel.x()), static_cast<float>(projection.pixel.y()),
                static_cast<float>(radius * scale(projection.octave)), projection.octave - 1,
                projection.octave, near);
  std::optional<std::uint16_t> best;
  int best_distance = max_distance + 1;
  for (const std::uint16_t f : near) {
    if (!fits(projection, feature(f))) continue;
    const int distance = hamming_distance(landmark.descriptor, node->features().descriptors[f]);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = f;
  }
  return best;
}

}  // namespace cairn
