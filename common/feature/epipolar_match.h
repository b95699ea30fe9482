// Pairs of features of two images that may show the same point, when nothing is known about it but
// that it lies on the epipolar line; and the points that follow from them.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "common/feature/two_view.h"

namespace cairn {

using FeaturePair = std::pair<std::uint16_t, std::uint16_t>;  // of a, of b

struct PairOptions {
  int max_distance = 50;             // bits in which the two descriptors may differ
  double ratio = 0.8;                // best distance over second best on the epipolar line
  double max_relative_sigma = 0.15;  // of the distance; 0.15 is about 1 degree of parallax
  double scale_tolerance = 1.8;      // octaves must agree with distances within this factor
};

// Matches features free_a of `a` with features free_b of `b`: each with at most one, by descriptor,
// distinct and with one common turn of the orientation. Tries every pair, which at some hundred
// features each costs less than an index would.
std::vector<FeaturePair> match_on_epipolar_lines(const View& a,
                                                 const std::vector<std::uint16_t>& free_a,
                                                 const View& b,
                                                 const std::vector<std::uint16_t>& free_b,
                                                 const PairOptions& options);

struct PairPoint {
  std::uint16_t a = 0, b = 0;  // features
  Eigen::Vector3d position;    // in map
};

// Matches along epipolar lines, triangulates (using depth where it was measured), and keeps what
// lies in front of both, reprojects well in both, is certain enough and agrees in scale.
// Deterministic.
std::vector<PairPoint> triangulate_pairs(const View& a, const std::vector<std::uint16_t>& free_a,
                                         const View& b, const std::vector<std::uint16_t>& free_b,
                                         const PairOptions& options);

}  // namespace cairn
