// Keyframes of a camera that passes random points: what a client would send, without images.
// Deterministic by seed. Header only, for the tests of server/map, mapping, optimize and so on.
//
//   SyntheticMap world({.keyframes = 12});
//   Map map = built(world);
//
// The camera moves along x, looks along z and turns a little; the first camera is the origin of
// odom and of map. Every point has a descriptor of its own, of which each view flips a few bits.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "common/model/keyframe.h"
#include "server/map/apply.h"

namespace cairn {

struct SyntheticOptions {
  int keyframes = 10;
  int points = 600;
  std::uint64_t seed = 1;
  std::uint64_t epoch = 7;        // of the client
  Sensor sensor = Sensor::kRgbd;  // with kMono there is no depth and there are no matches
  double step = 0.12;             // metres between keyframes
  double start = 0.0;             // x of the first camera, metres
  double pixel_noise = 0.3;       // standard deviation at octave 0, pixels
  double drift = 0.0;             // standard deviation of each step's error, metres and radians
  double depth_share = 1.0;       // of the features that have depth
  double report_share = 1.0;      // of the repeated sights that the client reports as a match
  double duplicate_share = 0.0;   // of the unreported repeats with depth that get a second landmark
  int flipped_bits = 6;           // of a descriptor in each view, at most
  double length = 4.0;            // of the scene along x beyond the first view, metres
};

class SyntheticMap {
 public:
  explicit SyntheticMap(const SyntheticOptions& o) : options(o), random_(o.seed) {
    make_rig();
    make_points();
    name_of_point_.resize(points.size());
    for (int k = 0; k < options.keyframes; ++k) make_keyframe(k);
  }

  SyntheticOptions options;
  std::shared_ptr<const Rig> rig;
  std::vector<Eigen::Vector3d> points;  // in map
  std::vector<Descriptor> descriptors;  // of points
  std::vector<KeyframePtr> keyframes;
  std::vector<Rigid3> map_from_camera;     // the truth, one a keyframe
  std::vector<std::vector<int>> point_of;  // [keyframe][feature] -> index in points

 private:
  double uniform(double low, double high) {
    return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1.0p-53;
  }
  // Sum of twelve uniforms: close to normal, and alike with every standard library.
  double normal() {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += uniform(0, 1);
    return sum;
  }

  void make_rig() {
    Rig r;
    r.sensor = options.sensor;
    r.camera = {.fx = 500,
                .fy = 500,
                .cx = 319.5,
                .cy = 239.5,
                .width = 640,
                .height = 480,
                .baseline = options.sensor == Sensor::kMono ? 0.0 : 0.08};
    r.max_depth = 40 * 0.08;
    rig = std::make_shared<const Rig>(r);
  }

  void make_points() {
    for (int i = 0; i < options.points; ++i) {
      points.emplace_back(uniform(-2.5, 2.5 + options.length), uniform(-1.6, 1.6),
                          uniform(2.0, 5.0));
      descriptors.push_back({random_(), random_(), random_(), random_()});
      angles_.push_back(uniform(0, 2 * M_PI));
      sizes_.push_back(uniform(5.5, 12.0));  // the distance at which it shows at octave 0
    }
  }

  Rigid3 true_pose(int k) const {
    const double x = options.start + options.step * k;
    const Eigen::Vector3d turn(0.03 * std::sin(1.1 * k), 0.06 * std::sin(0.5 * k), 0);
    return {k == 0 && options.start == 0.0 ? Eigen::Quaterniond::Identity() : so3_exp(turn),
            {x, 0.05 * std::sin(0.7 * k), 0}};
  }

  Descriptor seen(const Descriptor& d) {
    Descriptor view = d;
    for (int i = 0; i < options.flipped_bits; ++i) {
      const auto bit = static_cast<unsigned>(random_() % 256);
      view[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    }
    return view;
  }

  void make_keyframe(int k) {
    auto keyframe = std::make_shared<Keyframe>();
    keyframe->id = {options.epoch, static_cast<std::uint32_t>(k)};
    keyframe->stamp_ns = std::int64_t{k} * 100'000'000;
    keyframe->rig = rig;
    map_from_camera.push_back(true_pose(k));
    set_pose(*keyframe, k);
    point_of.emplace_back();
    for (std::size_t i = 0; i < points.size(); ++i) add_feature(*keyframe, static_cast<int>(i));
    keyframes.push_back(keyframe);
  }

  void set_pose(Keyframe& keyframe, int k) {
    keyframe.odom_from_camera = map_from_camera.back();
    if (k == 0) return;
    const auto last = static_cast<std::size_t>(k) - 1;
    Eigen::Matrix<double, 6, 1> error;
    for (int i = 0; i < 6; ++i) error[i] = options.drift * normal();
    keyframe.reference = keyframes[last]->id;
    keyframe.reference_from_camera =
        perturbed(map_from_camera[last].inverse() * map_from_camera.back(), error);
    keyframe.odom_from_camera = keyframes[last]->odom_from_camera * keyframe.reference_from_camera;
  }

  void add_feature(Keyframe& keyframe, int i) {
    const auto point = static_cast<std::size_t>(i);
    const Eigen::Vector3d p = map_from_camera.back().inverse() * points[point];
    if (p.z() < 0.3) return;
    const PinholeCamera& camera = rig->camera;
    const double octave = std::ceil(std::log(sizes_[point] / p.norm()) / std::log(1.2));
    Feature f;
    f.octave = static_cast<std::uint8_t>(std::clamp(octave, 0.0, 7.0));
    const double sigma = options.pixel_noise * rig->pyramid.scale(f.octave);
    const Eigen::Vector2d pixel = camera.project(p) + sigma * Eigen::Vector2d(normal(), normal());
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > 639 || pixel.y() > 479) return;
    f.x = static_cast<float>(pixel.x());
    f.y = static_cast<float>(pixel.y());
    f.angle = static_cast<float>(angles_[point]);
    if (options.sensor != Sensor::kMono && uniform(0, 1) < options.depth_share)
      f.disparity = static_cast<float>(camera.disparity(p.z()) + 0.3 * sigma * normal());
    const auto index = static_cast<std::uint16_t>(keyframe.features.size());
    keyframe.features.points.push_back(f);
    keyframe.features.descriptors.push_back(seen(descriptors[point]));
    point_of.back().push_back(i);
    if (options.sensor != Sensor::kMono) add_match(keyframe, point, index);
  }

  void add_match(Keyframe& keyframe, std::size_t point, std::uint16_t feature) {
    LandmarkId& name = name_of_point_[point];
    const Feature& f = keyframe.features.points[feature];
    const bool makeable = f.has_depth() && rig->camera.depth(f.disparity) < rig->max_depth;
    if (name.is_valid() && uniform(0, 1) < options.report_share) {
      keyframe.matches.push_back({feature, name});
    } else if (makeable && (!name.is_valid() || uniform(0, 1) < options.duplicate_share)) {
      const LandmarkId made = LandmarkId::from_feature(keyframe.id, feature);
      if (!name.is_valid()) name = made;
      keyframe.matches.push_back({feature, made});
    }
  }

  std::mt19937_64 random_;
  std::vector<double> angles_, sizes_;
  std::vector<LandmarkId> name_of_point_;
};

// The map that comes of the first `keyframes` of them, all by default, before any mapping.
inline Map built(const SyntheticMap& world,
                 std::size_t keyframes = std::numeric_limits<std::size_t>::max()) {
  Map map;
  for (std::size_t k = 0; k < std::min(keyframes, world.keyframes.size()); ++k)
    apply_keyframe(map, world.keyframes[k]);
  return map;
}

}  // namespace cairn
