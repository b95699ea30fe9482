// Binary descriptors for tests: random ones, and views of one with some bits flipped.
#pragma once

#include <cstddef>
#include <random>
#include <vector>

#include "common/model/features.h"

namespace cairn {

inline Descriptor random_descriptor(std::mt19937_64& random) {
  return {random(), random(), random(), random()};
}

// Exactly `bits` of them flipped, 256 at most.
inline Descriptor with_flips(Descriptor descriptor, int bits, std::mt19937_64& random) {
  Descriptor flipped{};
  while (bits > 0) {
    const auto bit = random() % 256;
    const std::uint64_t mask = std::uint64_t{1} << (bit % 64);
    if (flipped[bit / 64] & mask) continue;
    flipped[bit / 64] |= mask;
    descriptor[bit / 64] ^= mask;
    --bits;
  }
  return descriptor;
}

// Images that show `shown` of `things` each, every thing with `bits` bits flipped.
inline std::vector<std::vector<Descriptor>> images_of(const std::vector<Descriptor>& things,
                                                      std::size_t images, std::size_t shown,
                                                      int bits, std::mt19937_64& random) {
  std::vector<std::vector<Descriptor>> result(images);
  for (auto& image : result)
    for (std::size_t i = 0; i < shown; ++i)
      image.push_back(with_flips(things[random() % things.size()], bits, random));
  return result;
}

}  // namespace cairn
