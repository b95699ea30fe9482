#include "server/place/k_majority.h"

#include <set>

#include <gtest/gtest.h>

#include "common/feature/hamming.h"
#include "tests/unit/server/place/descriptors.h"

namespace cairn {
namespace {

TEST(Majority, TakesEachBitAsMostHaveIt) {
  const std::vector<Descriptor> three{{0b0011, 0, 0, 0}, {0b0101, 0, 0, 0}, {0b1001, 0, 0, 1}};
  EXPECT_EQ(majority(three), (Descriptor{0b0001, 0, 0, 0}));
}

TEST(Majority, WhereEvenTakesTheFirst) {
  const std::vector<Descriptor> two{{0b01, 0, 0, 0}, {0b10, 0, 0, 0}};
  EXPECT_EQ(majority(two), two[0]);
}

TEST(KMajority, SeparatesWhatIsSeparate) {
  std::mt19937_64 random(3);
  std::vector<Descriptor> centres, views;
  for (int i = 0; i < 8; ++i) centres.push_back(random_descriptor(random));
  for (int i = 0; i < 400; ++i)
    views.push_back(with_flips(centres[static_cast<std::size_t>(i) % 8], 8, random));
  const Clusters clusters = k_majority(views, 8, 20, random);
  ASSERT_EQ(clusters.centres.size(), 8u);
  for (std::size_t i = 0; i < views.size(); ++i) {
    EXPECT_EQ(clusters.cluster_of[i], clusters.cluster_of[i % 8]);
    // 50 views with 8 of 256 bits wrong outvote the wrong bits.
    EXPECT_EQ(clusters.centres[clusters.cluster_of[i]], centres[i % 8]);
  }
}

TEST(KMajority, MakesNoMoreClustersThanThereAreDifferentDescriptors) {
  std::mt19937_64 random(4);
  const std::vector<Descriptor> same(20, random_descriptor(random));
  EXPECT_EQ(k_majority(same, 5, 10, random).centres.size(), 1u);
  EXPECT_TRUE(k_majority({}, 5, 10, random).centres.empty());
}

TEST(KMajority, LeavesNoClusterEmpty) {
  std::mt19937_64 random(5);
  std::vector<Descriptor> views;
  for (int i = 0; i < 300; ++i) views.push_back(random_descriptor(random));
  const Clusters clusters = k_majority(views, 40, 10, random);
  const std::set<int> used(clusters.cluster_of.begin(), clusters.cluster_of.end());
  EXPECT_EQ(used.size(), clusters.centres.size());
}

}  // namespace
}  // namespace cairn
