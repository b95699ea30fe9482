// The vocabulary's file as bytes; its layout stands in vocabulary.h.
#pragma once

#include <cstdint>

#include "server/place/vocabulary.h"

namespace cairn {

// Of everything that the file holds behind its header.
std::uint64_t checksum_of(const VocabularyTree& tree);

}  // namespace cairn
