#include "common/model/ids.h"

#include <set>
#include <unordered_set>
#include <vector>

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Ids, DefaultsAreNotValid) {
  EXPECT_FALSE(KeyframeId{}.is_valid());
  EXPECT_FALSE(LandmarkId{}.is_valid());
  EXPECT_TRUE((KeyframeId{7, 0}).is_valid());
  EXPECT_TRUE((LandmarkId{LandmarkId::kServer, 1}).is_valid());
}

TEST(Ids, KeyframesAreOrderedByRunAndThenByTime) {
  const std::set<KeyframeId> ids = {{2, 0}, {1, 5}, {1, 3}};
  const std::vector<KeyframeId> ordered(ids.begin(), ids.end());
  EXPECT_EQ(ordered, (std::vector<KeyframeId>{{1, 3}, {1, 5}, {2, 0}}));
}

TEST(Ids, ALandmarkNamesTheFeatureThatItWasMadeFrom) {
  const KeyframeId keyframe{0xfeedULL << 40, 4'000'000'000};
  for (const std::uint16_t feature : {0, 1, 65535}) {
    const LandmarkId id = LandmarkId::from_feature(keyframe, feature);
    EXPECT_TRUE(id.is_valid());
    EXPECT_EQ(id.creator(), keyframe);
    EXPECT_EQ(id.creator_feature(), feature);
    EXPECT_NE(id.origin, LandmarkId::kServer);
  }
}

TEST(Ids, ARestartedClientIsAnother) {
  EXPECT_NE((ClientId{"drone", 1}), (ClientId{"drone", 2}));
  EXPECT_NE(LandmarkId::from_feature({1, 0}, 0), LandmarkId::from_feature({2, 0}, 0));
}

TEST(Ids, NeighbouringIdsHashApart) {
  // Sequences and feature numbers count up by one; tables take low and high bits of the hash, and
  // both must spread: 4096 ids over 256 slots of either kind leave none empty.
  std::unordered_set<std::size_t> low, high, all;
  for (std::uint32_t i = 0; i < 64; ++i) {
    for (std::uint16_t f = 0; f < 64; ++f) {
      const std::size_t h = std::hash<LandmarkId>{}(LandmarkId::from_feature({99, i}, f));
      all.insert(h);
      low.insert(h % 256);
      high.insert((h >> 40) % 256);
    }
  }
  EXPECT_EQ(all.size(), 4096u);
  EXPECT_EQ(low.size(), 256u);
  EXPECT_EQ(high.size(), 256u);
}

TEST(Ids, KeyframeHashesDiffer) {
  std::unordered_set<std::size_t> all;
  for (std::uint32_t i = 0; i < 1000; ++i) all.insert(std::hash<KeyframeId>{}({5, i}));
  EXPECT_EQ(all.size(), 1000u);
}

}  // namespace
}  // namespace cairn
