#include "tests/support/trajectory.h"

#include <array>
#include <cmath>
#include <numbers>

#include "tests/support/random.h"

namespace cairn::synthetic {
namespace {

constexpr double kPi = std::numbers::pi;

// Where the sharp path (straight sides, circular corners) is after `distance` metres, and the
// direction there, counted on over the rounds.
struct Waypoint {
  double x, y, heading;
};

Waypoint sharp_path(const LoopPath& p, double distance) {
  const double r = p.corner_radius;
  const double straight_x = 2 * (p.half_x - r), straight_y = 2 * (p.half_y - r), arc = kPi / 2 * r;
  const double length = p.length();
  const double rounds = std::floor(distance / length);
  double rest = distance - rounds * length;
  double heading = 2 * kPi * rounds;
  // From the lower end of the right side, counter-clockwise.
  double x = p.half_x, y = -(p.half_y - r);
  for (int side = 0;; ++side) {
    const double straight = side % 2 == 0 ? straight_y : straight_x;
    const double angle = heading + kPi / 2;
    const double dx = std::cos(angle), dy = std::sin(angle);
    if (rest <= straight) return {x + rest * dx, y + rest * dy, angle};
    rest -= straight;
    x += straight * dx;
    y += straight * dy;
    const double turn = std::min(rest, arc) / r;
    // The corner's centre lies to the left.
    const double centre_x = x - r * dy, centre_y = y + r * dx;
    x = centre_x + r * std::sin(angle + turn);
    y = centre_y - r * std::cos(angle + turn);
    if (rest <= arc) return {x, y, angle + turn};
    rest -= arc;
    heading += kPi / 2;
  }
}

// The sharp path averaged over about a metre (less on small loops), so that turns begin gently.
Waypoint smooth_path(const LoopPath& p, double distance) {
  static constexpr std::array<double, 5> kNodes = {0, 0.5384693101056831, -0.5384693101056831,
                                                   0.9061798459386640, -0.9061798459386640};
  static constexpr std::array<double, 5> kWeights = {0.5688888888888889, 0.4786286704993665,
                                                     0.4786286704993665, 0.2369268850561891,
                                                     0.2369268850561891};
  const double half_window = std::min(0.5, 0.4 * p.corner_radius);
  Waypoint sum{0, 0, 0};
  for (std::size_t i = 0; i < kNodes.size(); ++i) {  // Gauss and Legendre's five points
    const Waypoint at = sharp_path(p, distance + half_window * kNodes[i]);
    sum.x += 0.5 * kWeights[i] * at.x;
    sum.y += 0.5 * kWeights[i] * at.y;
    sum.heading += 0.5 * kWeights[i] * at.heading;
  }
  return sum;
}

// Sum of three sines between 0.4 and 1.9 Hz; amplitude about 1.
double shake(std::uint64_t seed, int axis, double t) {
  Random random(derive_seed(seed, 77 + static_cast<std::uint64_t>(axis)));
  double sum = 0;
  for (const double hertz : {0.45, 0.9, 1.7}) {
    const double frequency = hertz * random.uniform(0.85, 1.15);
    const double phase = random.uniform(0, 2 * kPi);
    sum += std::sin(2 * kPi * frequency * t + phase) * 0.45 / hertz;
  }
  return sum;
}

}  // namespace

Rigid3 camera_pose(const Eigen::Vector3d& position, double yaw, double pitch, double roll) {
  const Eigen::Vector3d forward(std::cos(pitch) * std::cos(yaw), std::cos(pitch) * std::sin(yaw),
                                std::sin(pitch));
  const Eigen::Vector3d right(std::sin(yaw), -std::cos(yaw), 0);
  Eigen::Matrix3d world_from_camera;
  world_from_camera << right, forward.cross(right), forward;
  const Eigen::Quaterniond level(world_from_camera);
  return {(level * so3_exp({0, 0, roll})).normalized(), position};
}

double LoopPath::length() const {
  return 4 * (half_x - corner_radius) + 4 * (half_y - corner_radius) + 2 * kPi * corner_radius;
}

Rigid3 LoopPath::world_from_camera(double t) const {
  const Waypoint at = smooth_path(*this, start * length() + speed * t);
  const double heading = speed >= 0 ? at.heading : at.heading + kPi;
  const double sway = 0.012 * shake, turn = 0.016 * shake;
  const auto wobble = [&](int axis) { return synthetic::shake(seed, axis, t); };
  const double slow = std::sin(0.7 * t + static_cast<double>(seed % 7));
  const Eigen::Vector3d position(at.x + sway * wobble(0), at.y + sway * wobble(1),
                                 height + bob * slow + sway * wobble(2));
  return camera_pose(position, heading + look + turn * wobble(3),
                     pitch + 0.06 * shake * std::sin(0.53 * t + 1.0) + turn * wobble(4),
                     turn * wobble(5));
}

Result<Trajectory> Trajectory::make(const std::string& scene, int path, std::uint64_t seed) {
  if (path < 0) return {ErrorCode::kInvalidArgument, "path: must be 0 or more"};
  LoopPath loop;
  loop.seed = derive_seed(seed, static_cast<std::uint64_t>(path));
  loop.start = 0.19 * path;
  const double variant = path % 2 == 0 ? 0 : 1;
  if (scene == "desk") {  // round the desk, looking at it
    loop.half_x = 1.75 - 0.2 * variant;
    loop.half_y = loop.corner_radius = 1.45 + 0.1 * variant;
    loop.height = 1.35 + 0.15 * variant;
    loop.look = kPi / 2;
    loop.pitch = -0.32;
  } else if (scene == "hall") {  // round the exhibits, looking ahead and outward
    loop = {.half_x = 5.6 - 0.4 * variant,
            .half_y = 3.3 - 0.3 * variant,
            .corner_radius = 1.8,
            .speed = 0.7,
            .height = 1.5,
            .look = -0.5,
            .start = loop.start,
            .seed = loop.seed};
  } else if (scene == "corridor") {
    loop = {.half_x = 5.0 + 0.15 * variant,
            .half_y = 5.0 + 0.15 * variant,
            .corner_radius = 1.6,
            .speed = 1.0,
            .height = 1.45,
            .start = loop.start,
            .seed = loop.seed};
  } else if (scene == "turn") {  // once round in eight seconds
    loop = {.half_x = 0.09,
            .half_y = 0.09,
            .corner_radius = 0.09,
            .speed = 0.0707,
            .height = 1.4,
            .pitch = -0.1,
            .start = loop.start,
            .bob = 0.02,
            .seed = loop.seed};
  } else if (scene == "weak" || scene == "textureless" ||
             scene == "bare") {  // looking across the room
    loop = {.half_x = 0.9,
            .half_y = 0.9,
            .corner_radius = 0.9,
            .speed = 0.35,
            .height = 1.3,
            .look = kPi / 2,
            .pitch = -0.05,
            .start = loop.start,
            .seed = loop.seed};
    // It begins with the rich walls in sight.
    if (scene == "bare") loop.start += 0.55;
  } else if (scene == "posters" || scene == "bricks") {  // along the walls, looking at them
    loop = {.half_x = 1.9 - 0.3 * variant,
            .half_y = 1.4 - 0.2 * variant,
            .corner_radius = 0.9,
            .speed = 0.4,
            .height = 1.4,
            .look = -kPi / 2,
            .start = loop.start,
            .seed = loop.seed};
  } else {
    return {ErrorCode::kInvalidArgument, "no trajectory for scene '" + scene + "'"};
  }
  return Trajectory(loop);
}

}  // namespace cairn::synthetic
