// A world of points with random descriptors, seen without images: exact features, plus noise on
// request. For tests of tracking that should not depend on the front end.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "common/model/keyframe.h"

namespace cairn::testing {

inline std::shared_ptr<const Rig> test_rig() {
  Rig rig;
  rig.sensor = Sensor::kRgbd;
  rig.camera = {525, 525, 319.5, 239.5, 640, 480, 0.075};
  rig.max_depth = 3.0;
  return std::make_shared<Rig>(rig);
}

// The same without depth.
inline std::shared_ptr<const Rig> mono_test_rig() {
  Rig rig = *test_rig();
  rig.sensor = Sensor::kMono;
  rig.camera.baseline = 0;
  rig.max_depth = 0;
  return std::make_shared<Rig>(rig);
}

class FeatureWorld {
 public:
  // These points.
  FeatureWorld(unsigned seed, std::vector<Eigen::Vector3d> points)
      : random_(seed), points_(std::move(points)) {
    std::uniform_int_distribution<std::uint64_t> bits;
    for (std::size_t i = 0; i < points_.size(); ++i)
      descriptors_.push_back({bits(random_), bits(random_), bits(random_), bits(random_)});
  }

  // Points on the walls of a box around the origin, 4 m to a side, so that some are always in view.
  explicit FeatureWorld(unsigned seed, int points = 3000) : random_(seed) {
    std::uniform_real_distribution<double> along(-2, 2);
    std::uniform_int_distribution<int> wall(0, 5);
    std::uniform_int_distribution<std::uint64_t> bits;
    for (int i = 0; i < points; ++i) {
      Eigen::Vector3d p(along(random_), along(random_), along(random_));
      const int w = wall(random_);
      p(w / 2) = w % 2 ? 2 : -2;
      points_.push_back(p);
      descriptors_.push_back({bits(random_), bits(random_), bits(random_), bits(random_)});
    }
  }

  // What the rig's camera sees, with Gaussian noise of `sigma` pixels on position and disparity. A
  // descriptor has `flipped` wrong bits. point_of(i) tells which point feature i of the last view
  // is.
  Features view(const Rig& rig, const Rigid3& world_from_camera, double sigma = 0,
                int flipped = 0) {
    std::normal_distribution<double> noise(0, 1);
    std::uniform_int_distribution<std::size_t> bit(0, 255);
    Features features;
    point_of_.clear();
    const Rigid3 camera_from_world = world_from_camera.inverse();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      const Eigen::Vector3d p = camera_from_world * points_[i];
      if (p.z() < 0.3) continue;
      const Eigen::Vector2d pixel = rig.camera.project(p);
      if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= rig.camera.width ||
          pixel.y() >= rig.camera.height)
        continue;
      Feature f;
      f.x = static_cast<float>(pixel.x() + sigma * noise(random_));
      f.y = static_cast<float>(pixel.y() + sigma * noise(random_));
      if (rig.camera.baseline > 0)
        f.disparity =
            static_cast<float>(std::max(0.1, rig.camera.disparity(p.z()) + sigma * noise(random_)));
      // Points are of one size, so the octave goes with the distance: nearest at the coarsest.
      f.octave = static_cast<std::uint8_t>(
          std::clamp(std::log(6.0 / p.norm()) / std::log(1.2), 0.0, rig.pyramid.levels - 1.0));
      Descriptor d = descriptors_[i];
      for (int k = 0; k < flipped; ++k) {
        const std::size_t b = bit(random_);
        d[b / 64] ^= 1ULL << (b % 64);
      }
      features.points.push_back(f);
      features.descriptors.push_back(d);
      point_of_.push_back(i);
    }
    return features;
  }

  const Eigen::Vector3d& point_of(std::size_t feature) const { return points_[point_of_[feature]]; }
  std::size_t index_of(std::size_t feature) const { return point_of_[feature]; }
  std::mt19937& random() { return random_; }

 private:
  std::mt19937 random_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Descriptor> descriptors_;
  std::vector<std::size_t> point_of_;
};

// A hand-held camera wandering through the middle of the box; t in seconds.
inline Rigid3 wander(double t) {
  const Eigen::Vector3d position(0.5 * std::sin(0.5 * t), 0.1 * std::sin(0.9 * t),
                                 0.4 * std::sin(0.35 * t));
  return {so3_exp({0.15 * std::sin(0.6 * t), 0.4 * t, 0}), position};
}

}  // namespace cairn::testing
