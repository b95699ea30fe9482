// A keyframe made ready for searching: its camera's pose the way round that projection needs it,
// its features by position, its pyramid's scales.
#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "common/feature/feature_grid.h"
#include "server/map/map.h"

namespace cairn {

// Grids of the keyframes used last. A grid depends on the measurement alone, so an entry never goes
// stale. Not thread-safe: one a mapping thread.
class GridCache {
 public:
  explicit GridCache(std::size_t capacity = 256) : capacity_(capacity) {}
  std::shared_ptr<const FeatureGrid> grid(const Keyframe& keyframe);
  std::size_t size() const { return entries_.size(); }

 private:
  struct Entry {
    std::shared_ptr<const FeatureGrid> grid;
    std::list<KeyframeId>::iterator use;
  };
  std::size_t capacity_;
  std::list<KeyframeId> uses_;  // the latest first
  std::unordered_map<KeyframeId, Entry> entries_;
};

// Where a landmark should show in a keyframe.
struct Projection {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double disparity = 0;  // pixels; 0 for cameras without depth
  int octave = 0;        // predicted
};

// Where a landmark is as seen from a keyframe (metres, camera frame), if it can show there: inside
// the image, neither too near nor too far for the pyramid (0.8 min_distance to 1.2 max_distance),
// and seen less than 60 degrees off its normal.
std::optional<Eigen::Vector3d> can_show(const KeyframeNode& node, const Rigid3& camera_from_map,
                                        const Landmark& landmark);

// Refers to the node: keep the snapshot while using it. Safe to read from several threads.
class KeyframeView {
 public:
  KeyframeView(const KeyframeNode& node, GridCache& grids);

  KeyframeId id() const { return node->keyframe->id; }
  const PinholeCamera& camera() const { return node->rig().camera; }
  const Feature& feature(std::uint16_t f) const { return node->features().points[f]; }
  double scale(int octave) const { return scales_[static_cast<std::size_t>(octave)]; }

  // Nothing where the landmark can't show.
  std::optional<Projection> project(const Landmark& landmark) const;

  // The feature that looks most like the landmark, among those within `radius` pixels (times the
  // scale of the predicted octave) of the projection, at the predicted octave or one below, whose
  // reprojection passes the 95 % chi2 test. Nothing where the best one differs in more than
  // `max_distance` bits.
  std::optional<std::uint16_t> find(const Landmark& landmark, const Projection& projection,
                                    double radius, int max_distance) const;

  const KeyframeNode* node;
  Rigid3 camera_from_map;

 private:
  bool fits(const Projection& projection, const Feature& feature) const;

  std::shared_ptr<const FeatureGrid> grid_;
  std::vector<double> scales_;  // of the octaves
  double inverse_log_factor_;
};

}  // namespace cairn
