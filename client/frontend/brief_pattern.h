// The 256 binary tests of the descriptor.
//
// Learned on photographs by tests/bench/learn_brief.cc, which prints brief_pattern.cc. All points
// lie within kBriefRadius of the centre, so that no rotation takes them out of the patch.
#pragma once

#include <array>
#include <cstdint>

namespace cairn {

inline constexpr int kBriefTests = 256;
inline constexpr int kBriefRadius = 18;

// The test yields 1 where the smoothed image is darker at `a` than at `b`. Pixels off the corner,
// for an orientation of 0.
struct BriefTest {
  std::int8_t ax, ay, bx, by;
};

extern const std::array<BriefTest, kBriefTests> kBriefPattern;

}  // namespace cairn
