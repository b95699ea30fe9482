// A large map with known truth: RGB-D cameras some times round a ring, looking outwards at
// landmarks that each a few of them see, of any round. For benchmarks of solvers that take the
// whole map at once.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <vector>

#include "server/map/map.h"
#include "tests/support/random.h"

namespace cairn {

struct RingWorldOptions {
  int keyframes = 1000;
  int landmarks = 100000;
  int rounds = 5;
  int sights = 5;            // of each landmark, at most
  double step = 0.3;         // metres between keyframes
  double pixel_noise = 0.5;  // standard deviation, of the disparity too
  double turn_error = 0.005, move_error = 0.02, landmark_error = 0.05;  // radians, metres
};

class RingWorld {
 public:
  explicit RingWorld(const RingWorldOptions& o) : options(o), random_(1) {
    Rig r;
    r.camera = {500, 500, 319.5, 239.5, 640, 480, 0.08};
    r.max_depth = 8;
    rig_ = std::make_shared<const Rig>(r);
    for (int k = 0; k < o.keyframes; ++k) add_camera(k);
    for (int l = 0; l < o.landmarks; ++l) add_landmark(l);
    finish();
  }

  RingWorldOptions options;
  Map map;                    // disturbed, all but the first keyframe
  std::vector<Rigid3> truth;  // of keyframe k
  // Distance of the keyframes from the truth, RMSE in metres.
  template <typename PoseOf>
  double error(PoseOf&& pose_of) const {
    double sum = 0;
    for (int k = 0; k < options.keyframes; ++k)
      sum += (pose_of(id(k)).translation - truth[static_cast<std::size_t>(k)].translation)
                 .squaredNorm();
    return std::sqrt(sum / options.keyframes);
  }
  static KeyframeId id(int k) { return {7, static_cast<std::uint32_t>(k)}; }

 private:
  double radius() const { return per_round() * options.step / (2 * std::numbers::pi); }
  int per_round() const { return options.keyframes / options.rounds; }

  void add_camera(int k) {
    const double angle = 2 * std::numbers::pi * k / per_round();
    const Eigen::Quaterniond turn = so3_exp({0, angle, 0});
    truth.push_back({turn, turn * Eigen::Vector3d(0, 0, radius())});
    auto keyframe = std::make_shared<Keyframe>();
    keyframe->id = id(k);
    keyframe->stamp_ns = k;
    keyframe->rig = rig_;
    keyframes_.push_back(std::move(keyframe));
    sees_.emplace_back();
  }

  void add_landmark(int l) {
    const double angle = random_.uniform(0, 2 * std::numbers::pi);
    const Eigen::Vector3d position =
        so3_exp({0, angle, 0}) *
        Eigen::Vector3d(0, random_.uniform(-1.2, 1.2), radius() + random_.uniform(2, 5));
    Landmark landmark;
    landmark.id = {LandmarkId::kServer, static_cast<std::uint64_t>(l) + 1};
    const int nearest = static_cast<int>(angle / (2 * std::numbers::pi) * per_round());
    for (int tries = 0; tries < 4 * options.sights; ++tries) {
      if (static_cast<int>(landmark.observations.size()) == options.sights) break;
      const int place = (nearest + random_.integer(12) - 6 + per_round()) % per_round();
      see(random_.integer(options.rounds) * per_round() + place, position, landmark);
    }
    if (landmark.observations.size() < 2) return;
    landmark.reference = landmark.observations.front().keyframe;
    landmark.position = position;
    for (int i = 0; i < 3; ++i) landmark.position[i] += options.landmark_error * random_.normal();
    map.landmarks.insert(landmark.id, std::move(landmark));
  }

  void see(int k, const Eigen::Vector3d& position, Landmark& landmark) {
    const auto index = static_cast<std::size_t>(k);
    for (const Observation& o : landmark.observations)
      if (o.keyframe == id(k)) return;
    const Eigen::Vector3d p = truth[index].inverse() * position;
    const PinholeCamera& camera = rig_->camera;
    if (p.z() < 0.5) return;
    const Eigen::Vector2d pixel = camera.project(p);
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= camera.width || pixel.y() >= camera.height)
      return;
    Feature f;
    f.x = static_cast<float>(pixel.x() + options.pixel_noise * random_.normal());
    f.y = static_cast<float>(pixel.y() + options.pixel_noise * random_.normal());
    f.disparity =
        static_cast<float>(camera.disparity(p.z()) + options.pixel_noise * random_.normal());
    auto& features = keyframes_[index]->features;
    landmark.observations.push_back({id(k), static_cast<std::uint16_t>(features.size())});
    features.points.push_back(f);
    features.descriptors.push_back({});
    sees_[index].push_back(landmark.id);
  }

  void finish() {
    for (int k = 0; k < options.keyframes; ++k) {
      const auto index = static_cast<std::size_t>(k);
      KeyframeNode node;
      node.landmarks = sees_[index];
      // A sight of a landmark that came to nothing.
      for (LandmarkId& l : node.landmarks.edit())
        if (!map.landmarks.contains(l)) l = {};
      Eigen::Matrix<double, 6, 1> delta = Eigen::Matrix<double, 6, 1>::Zero();
      for (int i = 0; k > 0 && i < 6; ++i)
        delta[i] = (i < 3 ? options.turn_error : options.move_error) * random_.normal();
      node.map_from_camera = perturbed(truth[index], delta);
      if (k > 0) node.parent = id(k - 1);
      if (k + 1 < options.keyframes) node.children = {id(k + 1)};
      for (int d = 1; d <= 4; ++d)
        for (const int other : {k - d, k + d})
          if (other >= 0 && other < options.keyframes)
            node.covisible.edit().push_back({id(other), 120});
      node.keyframe = keyframes_[index];
      node.arrival = ++map.revision;
      map.keyframes.insert(id(k), std::move(node));
    }
  }

  synthetic::Random random_;
  std::shared_ptr<const Rig> rig_;
  std::vector<std::shared_ptr<Keyframe>> keyframes_;
  std::vector<std::vector<LandmarkId>> sees_;
};

}  // namespace cairn
