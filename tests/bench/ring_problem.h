// The ring as a problem for a program of Ceres alone.
#pragma once

#include "tests/bench/ring_world.h"
#include "tests/unit/server/optimize/bare_ba.h"

namespace cairn {

// The same keyframes and landmarks as plain arrays.
inline bare::Problem bare_problem(const RingWorld& world) {
  bare::Problem problem;
  const PinholeCamera& camera = world.map.keyframes.at(RingWorld::id(0)).rig().camera;
  problem.fx = camera.fx;
  problem.fy = camera.fy;
  problem.cx = camera.cx;
  problem.cy = camera.cy;
  problem.fx_baseline = camera.fx * camera.baseline;
  for (int k = 0; k < world.options.keyframes; ++k) {
    const Rigid3& pose = world.map.keyframes.at(RingWorld::id(k)).map_from_camera;
    for (int i = 0; i < 4; ++i) problem.poses.push_back(pose.rotation.coeffs()[i]);
    for (int i = 0; i < 3; ++i) problem.poses.push_back(pose.translation[i]);
  }
  for (const LandmarkId id : world.map.landmarks.sorted_keys()) {
    const Landmark& landmark = world.map.landmarks.at(id);
    const auto point = static_cast<std::uint32_t>(problem.points.size() / 3);
    for (int i = 0; i < 3; ++i) problem.points.push_back(landmark.position[i]);
    for (const Observation& o : landmark.observations) {
      const Feature& f = world.map.keyframes.at(o.keyframe).features().points[o.feature];
      problem.observations.push_back({o.keyframe.sequence, point, f.x, f.y, f.disparity});
    }
  }
  return problem;
}

}  // namespace cairn
