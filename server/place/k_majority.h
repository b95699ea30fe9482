// k-means for binary descriptors.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <span>
#include <vector>

#include "common/model/features.h"

namespace cairn {

// Each bit as most of the descriptors have it; where they are split evenly, as the first has it.
// Not for an empty set.
Descriptor majority(std::span<const Descriptor> descriptors);

struct Clusters {
  std::vector<Descriptor> centres;
  std::vector<std::uint8_t> cluster_of;  // one a descriptor
};

// Up to k clusters (k <= 255), none of them empty; fewer where there are fewer different
// descriptors. Seeded as k-means++ (Arthur and Vassilvitskii 2007).
Clusters k_majority(std::span<const Descriptor> descriptors, std::size_t k, int iterations,
                    std::mt19937_64& random);

}  // namespace cairn
