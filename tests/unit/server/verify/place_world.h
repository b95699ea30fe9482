// Rooms of points for tests of loop verification: what two clients would have mapped, without
// images, when they saw the same place, another one, or one that looks alike.
//
// A Room is points with descriptors, normals and sizes. A Visit is a few keyframes of one client in
// it, with noise on pixels and depth, and landmarks made of what each feature's depth said when it
// was first seen, or, by a single camera, of two views. Visits are parts of the same Map without
// anything in common.
#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

#include "server/map/apply.h"
#include "tests/support/random.h"

namespace cairn {

struct RoomPoint {
  Eigen::Vector3d position;  // in the room
  Descriptor descriptor;
  double size = 7;  // the distance in metres at which it shows at octave 0
  double angle = 0;
};
using Room = std::vector<RoomPoint>;

inline Descriptor random_descriptor(synthetic::Random& random) {
  return {random.bits(), random.bits(), random.bits(), random.bits()};
}

inline RoomPoint random_point(synthetic::Random& random, const Eigen::Vector3d& position) {
  return {position, random_descriptor(random), random.uniform(5.5, 9.0),
          random.uniform(0, 2 * M_PI)};
}

// Points at all depths within a box.
inline void add_clutter(Room& room, std::uint64_t seed, int count, const Eigen::Vector3d& low,
                        const Eigen::Vector3d& high) {
  synthetic::Random random(seed);
  for (int i = 0; i < count; ++i)
    room.push_back(
        random_point(random, {random.uniform(low.x(), high.x()), random.uniform(low.y(), high.y()),
                              random.uniform(low.z(), high.z())}));
}

// A print of one design, the same for the same seed, on the plane z = depth.
inline void add_poster(Room& room, std::uint64_t design, const Eigen::Vector3d& centre, double size,
                       int count) {
  synthetic::Random random(design);
  for (int i = 0; i < count; ++i)
    room.push_back(random_point(
        random,
        centre + size * Eigen::Vector3d(random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), 0)));
}

// A wall on z = depth where every brick has the same few points.
inline void add_brick_wall(Room& room, std::uint64_t seed, double depth, double width,
                           double height) {
  constexpr double kLong = 0.25, kHigh = 0.12;
  Room brick;
  add_clutter(brick, seed, 8, {0, 0, 0}, {kLong, kHigh, 0});
  for (double y = -height / 2; y < height / 2; y += kHigh)
    for (double x = -width / 2; x < width / 2; x += kLong)
      for (RoomPoint point : brick) {
        point.position += Eigen::Vector3d(x, y, depth);
        room.push_back(point);
      }
}

struct VisitOptions {
  std::uint64_t epoch = 7;
  int keyframes = 5;
  double step = 0.15;        // metres along x between keyframes
  Rigid3 room_from_first{};  // where the first camera stands
  Rigid3 map_from_room{};    // where the client believes that the room is
  double scale = 1;          // of the map, in units of the room
  double pixel_noise = 0.5;  // at octave 0
  double disparity_noise = 0.3;
  double wrong_descriptors = 0;  // share that look like anything
  double seen = 0.8;             // share of what is in view that a keyframe finds
  int flipped_bits = 12;         // in every view
  Sensor sensor = Sensor::kRgbd;
};

class Visit {
 public:
  Visit(Map& map, const Room& room, const VisitOptions& o)
      : options(o), map_(map), room_(room), random_(o.epoch), landmark_of_(room.size()) {
    for (int k = 0; k < o.keyframes; ++k) add_keyframe(k);
  }

  KeyframeId id(int k) const { return {options.epoch, static_cast<std::uint32_t>(k)}; }
  Rigid3 room_from_camera(int k) const {
    return options.room_from_first * Rigid3{{1, 0, 0, 0}, {options.step * k, 0, 0}};
  }
  // The point of the room that a landmark was made of; -1 for others.
  int point_of(LandmarkId landmark) const {
    const auto at = std::find(landmark_of_.begin(), landmark_of_.end(), landmark);
    return at == landmark_of_.end() ? -1 : static_cast<int>(at - landmark_of_.begin());
  }

  VisitOptions options;

 private:
  void add_keyframe(int k) {
    auto keyframe = std::make_shared<Keyframe>();
    keyframe->id = id(k);
    keyframe->rig = rig();
    const Rigid3 map_from_camera = in_map(room_from_camera(k));
    keyframe->odom_from_camera = map_from_camera;
    if (k > 0) {
      keyframe->reference = id(k - 1);
      keyframe->reference_from_camera = in_map(room_from_camera(k - 1)).inverse() * map_from_camera;
    }
    for (std::size_t i = 0; i < room_.size(); ++i) add_feature(*keyframe, i, k);
    apply_keyframe(map_, keyframe);
  }

  Rigid3 in_map(const Rigid3& room_from_camera) const {
    Rigid3 pose = options.map_from_room * room_from_camera;
    pose.translation *= options.scale;
    return pose;
  }

  std::shared_ptr<const Rig> rig() const {
    Rig rig;
    rig.sensor = options.sensor;
    const bool mono = options.sensor == Sensor::kMono;
    rig.camera = {500, 500, 319.5, 239.5, 640, 480, mono ? 0 : 0.08 * options.scale};
    rig.max_depth = mono ? 0 : 6 * options.scale;
    return std::make_shared<const Rig>(rig);
  }

  void add_feature(Keyframe& keyframe, std::size_t i, int k) {
    const RoomPoint& point = room_[i];
    const Eigen::Vector3d p = room_from_camera(k).inverse() * point.position;
    if (p.z() < 0.3 || !random_.chance(options.seen)) return;
    const ScalePyramid& pyramid = keyframe.rig->pyramid;
    Feature f;
    const double octave = std::ceil(std::log(point.size / p.norm()) / std::log(1.2));
    f.octave = static_cast<std::uint8_t>(std::clamp(octave, 0.0, 7.0));
    const double sigma = options.pixel_noise * pyramid.scale(f.octave);
    const PinholeCamera& camera = keyframe.rig->camera;
    const Eigen::Vector2d pixel =
        camera.project(p) + sigma * Eigen::Vector2d(random_.normal(), random_.normal());
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= 640 || pixel.y() >= 480) return;
    f.x = static_cast<float>(pixel.x());
    f.y = static_cast<float>(pixel.y());
    f.angle = static_cast<float>(point.angle);
    const bool mono = options.sensor == Sensor::kMono;
    if (!mono)
      f.disparity = static_cast<float>(camera.disparity(options.scale * p.z()) +
                                       options.disparity_noise * random_.normal());
    if (keyframe.features.size() >= 60000 || (!mono && f.disparity <= 1)) return;
    const auto index = static_cast<std::uint16_t>(keyframe.features.size());
    keyframe.features.points.push_back(f);
    keyframe.features.descriptors.push_back(look(point.descriptor));
    LandmarkId& landmark = landmark_of_[i];
    const bool is_new = !landmark.is_valid();
    if (is_new) landmark = LandmarkId::from_feature(keyframe.id, index);
    if (!mono || !is_new) keyframe.matches.push_back({index, landmark});
  }

  Descriptor look(Descriptor d) {
    if (random_.chance(options.wrong_descriptors)) return random_descriptor(random_);
    for (int i = 0; i < options.flipped_bits; ++i) {
      const auto bit = static_cast<unsigned>(random_.integer(256));
      d[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    }
    return d;
  }

  Map& map_;
  const Room& room_;
  synthetic::Random random_;
  std::vector<LandmarkId> landmark_of_;
};

}  // namespace cairn
