// Distance of binary descriptors: the number of tests in which they differ, 0 to 256.
#pragma once

#include <bit>

#include "common/model/features.h"

namespace cairn {

inline int hamming_distance(const Descriptor& a, const Descriptor& b) {
  return std::popcount(a[0] ^ b[0]) + std::popcount(a[1] ^ b[1]) + std::popcount(a[2] ^ b[2]) +
         std::popcount(a[3] ^ b[3]);
}

}  // namespace cairn
