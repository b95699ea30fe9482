#include "server/place/bag_of_words.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Similarity, OfWorkedExamples) {
  const BagOfWords a{{1, 0.5f}, {4, 0.25f}, {9, 0.25f}};
  const BagOfWords b{{1, 0.25f}, {5, 0.25f}, {9, 0.5f}};
  // |a - b|_1 = 0.25 + 0.25 + 0.25 + 0.25; 1 - 1 / 2.
  EXPECT_DOUBLE_EQ(similarity(a, b), 0.5);
  EXPECT_DOUBLE_EQ(similarity(b, a), 0.5);
  EXPECT_DOUBLE_EQ(similarity(a, a), 1.0);
}

TEST(Similarity, OfNothingInCommonIsZero) {
  const BagOfWords a{{1, 0.5f}, {3, 0.5f}};
  EXPECT_EQ(similarity(a, {{2, 1.0f}}), 0.0);
  EXPECT_EQ(similarity(a, {}), 0.0);
  EXPECT_EQ(similarity({}, {}), 0.0);
}

TEST(Similarity, IsAtMostOneDespiteRounding) {
  BagOfWords bag;
  for (std::uint32_t word = 0; word < 3000; ++word) bag.push_back({word, 1.0f / 2999.9f});
  EXPECT_LE(similarity(bag, bag), 1.0);
}

}  // namespace
}  // namespace cairn
