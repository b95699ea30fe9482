// A map with known truth for tests of solvers: poses and landmarks of a SyntheticMap as they are,
// then disturbed. Only what solvers read is filled in: poses, landmarks and observations.
#pragma once

#include <random>
#include <vector>

#include "server/map/map.h"
#include "server/map/window.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {

inline LandmarkId landmark_of_point(int point) {
  return {LandmarkId::kServer, static_cast<std::uint64_t>(point) + 1};
}

// A landmark gets at most `max_observations`; 0: no limit. With `wrong_every` n > 0 every n-th
// observation names the feature of another point.
inline Map known_map(const SyntheticMap& world, std::size_t max_observations = 0,
                     std::size_t wrong_every = 0) {
  std::size_t count = 0;
  Map map;
  map.id = {1};
  map.revision = 5;
  std::vector<Landmark> landmarks(world.points.size());
  for (std::size_t k = 0; k < world.keyframes.size(); ++k) {
    KeyframeNode node;
    node.keyframe = world.keyframes[k];
    node.map_from_camera = world.map_from_camera[k];
    node.landmarks.edit().resize(node.features().size());
    for (std::size_t f = 0; f < node.features().size(); ++f) {
      const int point = world.point_of[k][f];
      Landmark& landmark = landmarks[static_cast<std::size_t>(point)];
      if (max_observations != 0 && landmark.observations.size() == max_observations) continue;
      const bool wrong = wrong_every != 0 && ++count % wrong_every == 0;
      const std::size_t feature = wrong ? (f + 1) % node.features().size() : f;
      landmark.observations.push_back({node.keyframe->id, static_cast<std::uint16_t>(feature)});
      node.landmarks.edit()[f] = landmark_of_point(point);
    }
    const KeyframeId id = node.keyframe->id;
    map.keyframes.insert(id, std::move(node));
  }
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (landmarks[i].observations.empty()) continue;
    landmarks[i].id = landmark_of_point(static_cast<int>(i));
    landmarks[i].position = world.points[i];
    landmarks[i].reference = landmarks[i].observations.front().keyframe;
    map.landmarks.insert(landmarks[i].id, landmarks[i]);
  }
  return map;
}

// Moves the poses of `keyframes` and all landmarks at random by the given standard deviations.
inline void disturb(Map& map, const std::vector<KeyframeId>& keyframes, double rotation,
                    double translation, double landmark, std::uint64_t seed = 3) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  for (const KeyframeId& id : keyframes) {
    KeyframeNode* node = map.keyframes.edit(id);
    Eigen::Matrix<double, 6, 1> delta;
    for (int i = 0; i < 6; ++i) delta[i] = (i < 3 ? rotation : translation) * normal(random);
    node->map_from_camera = perturbed(node->map_from_camera, delta);
  }
  for (const LandmarkId& id : map.landmarks.sorted_keys())
    for (int i = 0; i < 3; ++i) map.landmarks.edit(id)->position[i] += landmark * normal(random);
}

// The last `free` keyframes, those before them as fixed ones, and all landmarks.
inline LocalWindow window_of(const SyntheticMap& world, const Map& map, int free) {
  LocalWindow window;
  const int first = static_cast<int>(world.keyframes.size()) - free;
  for (int k = 0; k < static_cast<int>(world.keyframes.size()); ++k)
    (k < first ? window.fixed_keyframes : window.free_keyframes)
        .push_back(world.keyframes[static_cast<std::size_t>(k)]->id);
  window.landmarks = map.landmarks.sorted_keys();
  return window;
}

}  // namespace cairn
