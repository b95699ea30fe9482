// Training of a vocabulary: hierarchical k-majority (k-means for binary descriptors: distances are
// Hamming's, and the mean of a cluster is its majority bit by bit; Grana et al. 2013, "A fast
// approach for integrating ORB descriptors in the bag of words model").
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "server/place/vocabulary.h"

namespace cairn {

struct TrainingOptions {
  std::size_t words = 33000;    // about that many, at most
  std::size_t branching = 16;   // clusters that a node is split into, 2 to 255
  std::size_t split_above = 8;  // descriptors that a node must hold to be split
  int iterations = 10;          // of k-majority, at most; it stops where nothing changes
  std::uint64_t seed = 1;
  // Of VocabularyTree. With 16 clusters a node, level 1 has 16 branches, in which 66 of 100 true
  // matches meet; level 2 has 256, and 47.
  std::uint32_t branch_level = 1;
  std::function<void(std::size_t words)> progress = {};  // called now and then
};

// `images`: the descriptors of each training image. The fullest cluster is split until there are
// enough words, so that words stand for about as many descriptors each. The weight of a word is
// ln(images / images with the word). Deterministic by the seed.
// Errors: kInvalidArgument for options out of range or too few descriptors for two words.
Result<Vocabulary> train_vocabulary(std::span<const std::vector<Descriptor>> images,
                                    const TrainingOptions& options);

}  // namespace cairn
