// What the front end finds in an image.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace cairn {

// 256 binary tests of steered BRIEF, 64 to a word.
using Descriptor = std::array<std::uint64_t, 4>;

struct Feature {
  float x = 0, y = 0;       // pixels in the ideal (undistorted) camera, at full resolution
  float disparity = 0;      // pixels, fx * baseline / depth; 0: depth unknown
  float angle = 0;          // orientation, radians in [0, 2 pi), clockwise on the image (y down)
  std::uint8_t octave = 0;  // pyramid level that it was found on, 0 is full resolution

  Eigen::Vector2d pixel() const { return {x, y}; }
  bool has_depth() const { return disparity > 0; }
};

// The features of one image: points[i] is described by descriptors[i].
struct Features {
  std::vector<Feature> points;
  std::vector<Descriptor> descriptors;

  std::size_t size() const { return points.size(); }
};

// The pyramid that features were found on.
struct ScalePyramid {
  float factor = 1.2f;  // between neighbouring levels
  std::uint8_t levels = 8;

  double scale(int octave) const;  // factor ^ octave
  // Standard deviation of a position in pixels, 1 at level 0. It grows slower than the scale: part
  // of it is the map's error and the camera model's, which coarse features don't feel more than
  // fine ones. Over seven levels (a factor of 3.6 in scale) the residuals of tracked recordings and
  // synthetic scenes grow by 1.2 to 2.0. The exponent is by experiment, see tests/bench/RESULTS.md.
  double sigma(int octave) const;
  bool operator==(const ScalePyramid&) const = default;
};

}  // namespace cairn
