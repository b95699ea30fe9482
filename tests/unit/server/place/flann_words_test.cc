#include "server/place/flann_words.h"

#include <gtest/gtest.h>

#include "tests/unit/server/place/descriptors.h"

namespace cairn {
namespace {

TEST(FlannWords, FindsNearlyAlwaysTheNearest) {
  std::mt19937_64 random(1);
  std::vector<Descriptor> words, queries;
  for (int i = 0; i < 2000; ++i) words.push_back(random_descriptor(random));
  for (int i = 0; i < 300; ++i)
    queries.push_back(with_flips(words[static_cast<std::size_t>(i)], 25, random));
  const auto found = FlannWords(words, {.checks = 512}).nearest(queries);
  std::size_t right = 0;
  for (std::size_t i = 0; i < found.size(); ++i) right += found[i] == i;
  EXPECT_GE(right, 270u);
}

}  // namespace
}  // namespace cairn
