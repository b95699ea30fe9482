// Keyframes and map updates with something in every field, the same for the same seed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>

#include "common/model/keyframe.h"
#include "common/model/map_update.h"
#include "common/model/measurement_noise.h"
#include "common/model/relocalise.h"

namespace cairn::testing {

inline std::shared_ptr<const Rig> sample_rig() {
  auto rig = std::make_shared<Rig>();
  rig->sensor = Sensor::kRgbd;
  rig->camera = {517.3, 516.5, 318.6, 255.3, 640, 480, 0.08};
  rig->max_depth = 4.5;
  return rig;
}

inline Rigid3 sample_pose(std::mt19937_64& random) {
  std::uniform_real_distribution<double> d(-1, 1);
  return {so3_exp({d(random), d(random), d(random)}), {d(random), d(random), d(random)}};
}

inline Descriptor sample_descriptor(std::mt19937_64& random) {
  return {random(), random(), random(), random()};
}

// Every third feature shows a landmark: its own, an earlier keyframe's, or the server's.
inline Keyframe sample_keyframe(KeyframeId id, std::size_t features = 50, std::uint64_t seed = 1) {
  std::mt19937_64 random(seed * 1000003 + id.sequence);
  std::uniform_real_distribution<float> unit(0, 1);
  Keyframe k;
  k.id = id;
  k.stamp_ns = 1305031453359684000 + std::int64_t{id.sequence} * 33'000'000;
  k.rig = sample_rig();
  k.odom_from_camera = sample_pose(random);
  k.odom_from_camera.scale = 0.8;
  if (id.sequence > 0) {
    k.reference = {id.epoch, id.sequence - 1};
    k.reference_from_camera = sample_pose(random);
    k.reference_from_camera.scale = 1.5;
  }
  k.noise = kMinNoise + (kMaxNoise - kMinNoise) * unit(random);
  for (std::size_t i = 0; i < features; ++i) {
    k.features.points.push_back({.x = unit(random) * 700 - 30,
                                 .y = unit(random) * 520 - 20,
                                 .disparity = i % 4 == 0 ? 0 : 5 + unit(random) * 40,
                                 .angle = unit(random) * 6.28f,
                                 .octave = static_cast<std::uint8_t>(i % 8)});
    k.features.descriptors.push_back(sample_descriptor(random));
    const auto f = static_cast<std::uint16_t>(i);
    if (i % 9 == 0) k.matches.push_back({f, LandmarkId::from_feature(id, f)});
    if (i % 9 == 3) k.matches.push_back({f, {LandmarkId::kServer, 1000 + i}});
    if (i % 9 == 6 && id.sequence > 0)
      k.matches.push_back({f, LandmarkId::from_feature({id.epoch, id.sequence - 1}, f)});
  }
  return k;
}

inline KeyframePtr sample_keyframe_ptr(KeyframeId id, std::size_t features = 20) {
  return std::make_shared<const Keyframe>(sample_keyframe(id, features));
}

inline MapUpdate sample_update(std::uint64_t epoch, std::size_t landmarks = 40,
                               std::uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> d(-5, 5);
  MapUpdate u;
  u.map = {77};
  u.base_revision = 3;
  u.revision = 4;
  u.merge_epoch = 2;
  u.new_map_from_old_map = Sim3(sample_pose(random));
  u.new_map_from_old_map->scale = 1.25;
  u.epoch = epoch;
  u.mapped_keyframes = 12;
  u.centre = {0.5, -0.25, 1};
  for (std::uint32_t i = 0; i < 5; ++i) u.keyframes.push_back({{epoch, i}, sample_pose(random)});
  u.keyframes[2].map_from_camera.scale = 1.3;
  u.removed_keyframes.push_back({{epoch, 6}, {epoch, 5}, sample_pose(random)});
  u.parts = {{0, 0}, {3, 1}, {7, 0}};
  for (std::uint64_t i = 0; i < landmarks; ++i) {
    LandmarkState l;
    l.id = i % 2 == 0 ? LandmarkId{LandmarkId::kServer, i + 1}
                      : LandmarkId::from_feature({epoch, 3}, static_cast<std::uint16_t>(i));
    l.position = {d(random), d(random), d(random)};
    l.normal = Eigen::Vector3d(d(random), d(random), 6).normalized();
    l.min_distance = 0.5f;
    l.max_distance = 6;
    l.descriptor = sample_descriptor(random);
    for (std::uint32_t o = 0; o < i % 7; ++o) l.observers.push_back({epoch + o % 2, o});
    if (i % 3 == 0) {
      l.descriptor = {};
      l.shown_by = OwnFeature{static_cast<std::uint32_t>(i % 20), static_cast<std::uint16_t>(i)};
    }
    u.landmarks.push_back(std::move(l));
    u.moved_landmarks.push_back({{LandmarkId::kServer, 5000 + 3 * i}, {d(random), d(random), 2}});
  }
  std::sort(u.landmarks.begin(), u.landmarks.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  u.removed_landmarks.push_back({{0, 900}, {}});
  u.removed_landmarks.push_back({{0, 901}, LandmarkId{0, 902}});
  return u;
}

// Found; every third landmark around is matched.
inline RelocaliseAnswer sample_answer(std::uint64_t epoch, std::size_t landmarks = 40,
                                      std::uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  RelocaliseAnswer a;
  a.epoch = epoch;
  a.number = 5;
  a.found = true;
  a.reference = {epoch + 9, 31};
  a.map_from_reference = sample_pose(random);
  a.map_from_reference.scale = 2.5;
  a.map_from_camera = sample_pose(random);
  a.around.map = {77};
  a.around.base_revision = 1;
  a.around.revision = 2;
  a.around.merge_epoch = 3;
  a.around.epoch = epoch;
  a.around.landmarks = sample_update(epoch, landmarks, seed).landmarks;
  for (std::size_t i = 0; i < landmarks; i += 3)
    a.matches.push_back({static_cast<std::uint16_t>(2 * i + 1), a.around.landmarks[i].id});
  return a;
}

}  // namespace cairn::testing
