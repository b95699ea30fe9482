// Bundle adjustment: the poses and landmarks that explain the observations best. The core that
// local and global adjustment share: take a problem out of a map, solve it, say what changed.
//
// Triggs et al. 2000, "Bundle adjustment: a modern synthesis": Levenberg-Marquardt, where each step
// eliminates the landmarks first (Schur complement), which leaves a system of the size of the
// poses. Observations weigh by their pixel's uncertainty and are robust by Huber's loss. Two
// rounds: what contradicts the result of the first is left out of the second.
//
// Everything works on values of its own; nothing here locks or changes a map. One call runs in the
// calling thread and gives the same result every time.
#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "server/map/delta.h"
#include "server/map/map.h"
#include "server/optimize/reprojection.h"

namespace cairn {

struct BundleOptions {
  int first_iterations = 5;    // with the outliers
  int second_iterations = 10;  // without
  // A round ends when a step lowers the cost by less than this fraction.
  double function_tolerance = 1e-4;
};

struct BundleSummary {
  bool usable = false;   // the state is at least as good as at the start
  bool stopped = false;  // ended early because it was asked to
  int keyframes = 0, fixed_keyframes = 0, landmarks = 0, observations = 0;
  int outliers = 0;
  int iterations = 0;  // of both rounds
  // Half the sum of squared, robustified errors in units of standard deviations: before, and of
  // what the second round keeps after.
  double initial_cost = 0, final_cost = 0;
  double extract_ms = 0, solve_ms = 0;
  std::string message;  // how it ended, one line
};

// A part of a map as a least-squares problem. Terms refer to poses and points by index.
struct BundleProblem {
  struct Pose {
    KeyframeId id;
    Rigid3 initial;  // map_from_camera in the snapshot
    bool fixed = false;
    Rigid3 map_from_camera;
  };
  struct Point {
    LandmarkId id;
    Eigen::Vector3d position;  // in map
  };
  struct Term {
    std::uint32_t pose = 0, point = 0;
    Observation observation;
    Reprojection reprojection;
    bool active = true;
  };
  // A landmark that a single view of a free keyframe knows says nothing about any pose: it is no
  // part of the problem and moves with that keyframe.
  struct Follower {
    std::uint32_t pose = 0;
    LandmarkId id;
    Eigen::Vector3d position_in_camera;
  };

  std::vector<Pose> poses;
  std::vector<Point> points;
  std::vector<Term> terms;  // ascending by point and then by pose, each pair once
  std::vector<Follower> followers;
};

// Only observations between the listed keyframes and landmarks count; ids that the map does not
// hold are skipped. Landmarks of which fewer than two observations count stay where they are,
// unless they are followers. When no fixed keyframe is left, the oldest free one is held: something
// has to say where the map lies.
BundleProblem extract_bundle(const Map& map, std::span<const KeyframeId> free_keyframes,
                             std::span<const KeyframeId> fixed_keyframes,
                             std::span<const LandmarkId> landmarks);

// Solves in place. Afterwards `active` tells which observations agree with the result. When asked
// to stop it ends after the step at hand with the best state so far. Where one pose is held and
// nothing tells the scale, the cameras keep their mean distance from it.
BundleSummary solve_bundle(BundleProblem& problem, const BundleOptions& options,
                           std::stop_token stop = {});

// What the solution changes in the map that the problem was taken from: poses, positions, and the
// observations that contradict it. Landmarks that keep fewer than two observations get no position.
MapDelta bundle_delta(const Map& map, const BundleProblem& problem);

}  // namespace cairn
