// An image as the words that its descriptors are: what place recognition compares.
#pragma once

#include <cstdint>
#include <vector>

namespace cairn {

struct WordWeight {
  std::uint32_t word = 0;
  float weight = 0;

  bool operator==(const WordWeight&) const = default;
};

// Ascending by word, no word twice, weights above 0 that sum to 1. Empty: nothing to compare by.
using BagOfWords = std::vector<WordWeight>;

// An image's features as words. Feature i has the word word_of_feature[i] and lies in the branch
// branch_of_feature[i] of the vocabulary. A branch holds many words: features that show the same
// thing usually have the same branch even where their words differ, so that it is enough to match
// features branch by branch.
struct Words {
  BagOfWords bag;
  std::vector<std::uint32_t> word_of_feature;
  std::vector<std::uint16_t> branch_of_feature;
};

// 0: no word in common, 1: the same. The L1 score 1 - |a - b|_1 / 2 (Nister and Stewenius 2006,
// Galvez-Lopez and Tardos 2012), which for weights that sum to 1 is the sum of the smaller weights.
double similarity(const BagOfWords& a, const BagOfWords& b);

}  // namespace cairn
