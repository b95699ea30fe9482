// One descriptor to stand for many.
#pragma once

#include <cstddef>
#include <span>

#include "common/model/features.h"

namespace cairn {

// Index of the descriptor whose median distance to the others is least, the first of equals; that
// is how a landmark seen in many keyframes is described. 0 for an empty set. Quadratic in the
// number of descriptors.
std::size_t median_descriptor(std::span<const Descriptor> descriptors);

}  // namespace cairn
