// Keyframes on a circle, as poses and covisibility alone: what a pose graph reads of a map.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "server/map/map.h"
#include "server/optimize/pose_graph.h"

namespace cairn {

struct RingOptions {
  int keyframes = 100;
  double radius = 5;             // metres
  double drift_rotation = 0;     // radians at each step, about the vertical
  double drift_translation = 0;  // share of each step by which it is told too long
  double drift_scale = 0;        // logarithm, by which it is told too small at the end of the ring
  double noise = 0;              // standard deviation of each step, metres and radians / 3
  int covisible = 3;             // keyframes ahead and behind with 150 shared landmarks
  std::uint64_t epoch = 7;
  std::uint64_t seed = 1;
  Rigid3 map_from_ring{};  // where the map says that the first keyframe is
};

// The last keyframe stands one step before the first, which it does not know.
class RingMap {
 public:
  explicit RingMap(const RingOptions& o) : options(o) {
    for (int k = 0; k < o.keyframes; ++k) {
      const double angle = 2 * M_PI * k / o.keyframes;
      const Eigen::Quaterniond turn = so3_exp({0, angle, 0});
      truth.push_back({turn, turn * Eigen::Vector3d(0, 0, -o.radius)});
    }
    const Rigid3 first_from_ring = truth.front().inverse();
    for (Rigid3& pose : truth) pose = first_from_ring * pose;
    drift();
  }

  KeyframeId id(int k) const { return {options.epoch, static_cast<std::uint32_t>(k)}; }
  LandmarkId landmark(int k) const { return LandmarkId::from_feature(id(k), 0); }

  // Adds the ring to a map: each keyframe with one landmark two metres ahead.
  void add_to(Map& map) const {
    auto rig = std::make_shared<Rig>();
    rig->sensor = Sensor::kMono;
    for (int k = 0; k < options.keyframes; ++k) {
      auto keyframe = std::make_shared<Keyframe>();
      keyframe->id = id(k);
      keyframe->stamp_ns = k;
      keyframe->rig = rig;
      keyframe->features.points.emplace_back();
      keyframe->features.descriptors.emplace_back();
      KeyframeNode node;
      node.keyframe = keyframe;
      node.map_from_camera = estimate[static_cast<std::size_t>(k)];
      node.landmarks = {landmark(k)};
      node.arrival = ++map.revision;
      if (k > 0) node.parent = id(k - 1);
      if (k + 1 < options.keyframes) node.children = {id(k + 1)};
      for (int d = 1; d <= options.covisible; ++d) {
        if (k >= d) node.covisible.edit().push_back({id(k - d), 150});
        if (k + d < options.keyframes) node.covisible.edit().push_back({id(k + d), 150});
      }
      Landmark l;
      l.id = landmark(k);
      l.position = node.map_from_camera * Eigen::Vector3d(0, 0, 2 * scale_at(k));
      l.observations = {{keyframe->id, 0}};
      l.reference = keyframe->id;
      map.landmarks.insert(l.id, l);
      map.keyframes.insert(keyframe->id, std::move(node));
    }
  }

  RelativePose loop(int from, int to) const { return {id(from), id(to), Sim3(relative(to, from))}; }
  Rigid3 relative(int to, int from) const {
    return truth[static_cast<std::size_t>(to)].inverse() * truth[static_cast<std::size_t>(from)];
  }

  // How large a metre is told to be around keyframe k.
  double scale_at(int k) const { return std::exp(-options.drift_scale * k / options.keyframes); }

  RingOptions options;
  std::vector<Rigid3> truth;     // in the frame of the first
  std::vector<Rigid3> estimate;  // in map

 private:
  void drift() {
    std::mt19937_64 random(options.seed);
    std::normal_distribution<double> normal;
    estimate.push_back(options.map_from_ring);
    for (int k = 1; k < options.keyframes; ++k) {
      Rigid3 step = relative(k - 1, k);
      step.translation *= (1 + options.drift_translation) * scale_at(k);
      step.rotation = so3_exp({0, options.drift_rotation, 0}) * step.rotation;
      if (options.noise > 0) {
        Eigen::Matrix<double, 6, 1> delta;
        for (int i = 0; i < 6; ++i)
          delta[i] = (i < 3 ? options.noise / 3 : options.noise) * normal(random);
        step = perturbed(step, delta);
      }
      estimate.push_back(estimate.back() * step);
    }
  }
};

}  // namespace cairn
