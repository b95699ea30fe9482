// Paths of a hand-held or carried camera through a synthetic world: closed forms of time, exact and
// smooth, without end (loops repeat).
#pragma once

#include <cstdint>
#include <string>

#include "common/geometry/rigid3.h"
#include "common/util/status.h"

namespace cairn::synthetic {

// Round a rectangle with rounded corners (an ellipse-like orbit when the corners take all of it),
// at constant speed, looking at a fixed angle to the way ahead, with the shake of a hand.
struct LoopPath {
  double half_x = 1, half_y = 1;  // metres, half the sides of the rectangle
  double corner_radius = 1;       // metres, at most the smaller half side
  double speed = 0.4;             // metres a second; counter-clockwise when positive
  double height = 1.4;            // metres
  double look = 0;                // radians to the left of the way ahead
  double pitch = 0;               // radians upward
  double start = 0;               // share of the loop, 0..1
  double shake = 1;               // 1: as a careful hand: about 1 cm and 1 degree
  double bob = 0.08;              // metres of slow up and down
  std::uint64_t seed = 1;         // of the shake

  double length() const;  // metres once round
  Rigid3 world_from_camera(double seconds) const;
};

// A camera path of a scene. Turning on the spot is a loop of some centimetres at high turn rate.
class Trajectory {
 public:
  // `path` 0, 1, 2, ... : different ways through the same scene that overlap in part. Each starts
  // elsewhere on the loop, every second one of `desk`, `hall`, `posters` and `bricks` at another
  // distance and height. Error for unknown scenes and negative paths.
  static Result<Trajectory> make(const std::string& scene, int path, std::uint64_t seed);
  explicit Trajectory(const LoopPath& path) : path_(path) {}

  Rigid3 world_from_camera(double seconds) const { return path_.world_from_camera(seconds); }
  // Seconds once round.
  double period() const { return path_.length() / std::abs(path_.speed); }

 private:
  LoopPath path_;
};

// The pose of a camera that looks `yaw` radians from the world's x axis and `pitch` upward, and is
// tilted clockwise by `roll`.
Rigid3 camera_pose(const Eigen::Vector3d& position, double yaw, double pitch, double roll);

}  // namespace cairn::synthetic
