#include "server/map/landmark_set.h"

#include <random>
#include <set>

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(LandmarkSet, TakesEachNameOnceHoweverManyThereAre) {
  for (const std::size_t expected : {0u, 5000u}) {
    LandmarkSet set(expected);
    std::set<LandmarkId> reference;
    std::mt19937_64 random(1);
    for (int i = 0; i < 20000; ++i) {
      const LandmarkId id{random() % 3, 1 + random() % 3000};
      EXPECT_EQ(set.insert(id), reference.insert(id).second);
    }
    EXPECT_EQ(set.size(), reference.size());
  }
}

}  // namespace
}  // namespace cairn
