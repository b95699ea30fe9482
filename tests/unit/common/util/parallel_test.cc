#include "common/util/parallel.h"

#include <gmock/gmock.h>

#include <vector>

namespace cairn {
namespace {

TEST(ForEachIndex, TakesEachOnce) {
  std::vector<int> taken(1000);
  for_each_index(taken.size(), [&](std::size_t i) { ++taken[i]; });
  EXPECT_THAT(taken, testing::Each(1));
}

TEST(ForEachIndex, OfNothingDoesNothing) {
  for_each_index(0, [](std::size_t) { FAIL(); });
}

}  // namespace
}  // namespace cairn
