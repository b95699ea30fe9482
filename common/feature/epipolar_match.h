// Pairs of features of two keyframes that may show the same point, when nothing is known about it
// but that it lies on the epipolar line.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "server/mapping/keyframe_view.h"
#include "server/mapping/triangulate.h"

namespace cairn {

using FeaturePair = std::pair<std::uint16_t, std::uint16_t>;  // of a, of b

// Matches features free_a of `a` with features free_b of `b`: each with at most one. Tries every
// pair, which at some hundred features each costs less than an index would.
std::vector<FeaturePair> match_on_epipolar_lines(const KeyframeView& a,
                                                 const std::vector<std::uint16_t>& free_a,
                                                 const KeyframeView& b,
                                                 const std::vector<std::uint16_t>& free_b,
                                                 const TriangulateOptions& options);

}  // namespace cairn
