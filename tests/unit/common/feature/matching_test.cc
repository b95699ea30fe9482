#include "common/feature/matching.h"

#include <algorithm>
#include <random>

#include <gtest/gtest.h>

#include "common/feature/descriptor.h"
#include "common/feature/hamming.h"

namespace cairn {
namespace {

Descriptor random_descriptor(std::mt19937_64& rng) {
  return {rng(), rng(), rng(), rng()};
}

Descriptor with_bits_flipped(Descriptor d, int bits) {
  for (int i = 0; i < bits; ++i) d[static_cast<std::size_t>(i) / 64] ^= 1ull << (i % 64);
  return d;
}

TEST(HammingDistance, CountsDifferingTests) {
  const Descriptor zero{};
  EXPECT_EQ(hamming_distance(zero, zero), 0);
  EXPECT_EQ(hamming_distance(zero, {1, 3, 0, 1ull << 63}), 4);
  EXPECT_EQ(hamming_distance(zero, {~0ull, ~0ull, ~0ull, ~0ull}), 256);
}

TEST(MedianDescriptor, IsTheOneInTheMiddleOfTheOthers) {
  std::mt19937_64 rng(1);
  const Descriptor centre = random_descriptor(rng);
  std::vector<Descriptor> set = {random_descriptor(rng), with_bits_flipped(centre, 20), centre,
                                 with_bits_flipped(centre, 30), random_descriptor(rng)};
  // Flips of 20 and 30 share their first bits, so the one with 20 is 10 from the one with 30; its
  // median is 20, as is the centre's: the first counts.
  EXPECT_EQ(median_descriptor(set), 1u);
  set[1][3] ^= 0xffff;  // now 36 from the centre and 26 from the other
  EXPECT_EQ(median_descriptor(set), 3u);
}

TEST(MedianDescriptor, IsTheFirstOfOneOrTwo) {
  const std::vector<Descriptor> two(2);
  EXPECT_EQ(median_descriptor(two), 0u);
  EXPECT_EQ(median_descriptor({}), 0u);
}

TEST(Nearest, FindsBestAndRunnerUpAmongCandidates) {
  std::mt19937_64 rng(2);
  const Descriptor wanted = random_descriptor(rng);
  const std::vector<Descriptor> set = {wanted, with_bits_flipped(wanted, 30),
                                       with_bits_flipped(wanted, 8), with_bits_flipped(wanted, 12)};
  const std::vector<std::uint16_t> candidates = {3, 1, 2};
  const Nearest n = nearest(wanted, candidates, set);
  EXPECT_EQ(n.index, 2);
  EXPECT_EQ(n.distance, 8);
  EXPECT_EQ(n.runner_up, 3);
  EXPECT_EQ(n.runner_up_distance, 12);
  EXPECT_EQ(nearest(wanted, set).index, 0);
}

TEST(BestMatch, RefusesWhatIsFarOrAmbiguous) {
  std::mt19937_64 rng(3);
  const Descriptor wanted = random_descriptor(rng);
  const std::vector<Descriptor> set = {with_bits_flipped(wanted, 40),
                                       with_bits_flipped(wanted, 44)};
  const std::vector<std::uint16_t> both = {0, 1}, second = {1};
  EXPECT_EQ(best_match(wanted, both, set, 50), 0);
  EXPECT_EQ(best_match(wanted, both, set, 50, 0.8f), -1);
  EXPECT_EQ(best_match(wanted, both, set, 39), -1);
  EXPECT_EQ(best_match(wanted, second, set, 50, 0.8f), 1);
  EXPECT_EQ(best_match(wanted, std::span<const std::uint16_t>{}, set, 50), -1);
}

TEST(MatchMutual, PairsWhatIsNearestBothWays) {
  std::mt19937_64 rng(4);
  std::vector<Descriptor> a(20), b(20);
  for (std::size_t i = 0; i < 20; ++i) {
    a[i] = random_descriptor(rng);
    b[19 - i] = with_bits_flipped(a[i], static_cast<int>(i));
  }
  a.push_back(with_bits_flipped(a[7], 2));  // 5 from b[12]: takes it from a[7], which is 7 away
  const auto matches = match_mutual(a, b, 15);
  ASSERT_EQ(matches.size(), 16u);  // 0 .. 15 without 7, and 20
  for (const FeatureMatch& m : matches) {
    if (m.a == 20) {
      EXPECT_EQ(m, (FeatureMatch{20, 12, 5}));
      continue;
    }
    EXPECT_NE(m.a, 7);
    EXPECT_EQ(m, (FeatureMatch{m.a, static_cast<std::uint16_t>(19 - m.a), m.a}));
  }
  EXPECT_TRUE(
      std::is_sorted(matches.begin(), matches.end(),
                     [](const FeatureMatch& l, const FeatureMatch& r) { return l.a < r.a; }));
}

TEST(ConsistentTurns, KeepsTheCommonTurnAlsoAcrossTheFullCircle) {
  std::vector<float> turns;
  for (int i = 0; i < 50; ++i) turns.push_back(i % 2 ? 0.02f : 6.26f);  // all about zero
  turns.push_back(1.5f);
  turns.push_back(-2.0f);
  const auto good = consistent_turns(turns);
  for (std::size_t i = 0; i < 50; ++i) EXPECT_TRUE(good[i]);
  EXPECT_FALSE(good[50]);
  EXPECT_FALSE(good[51]);
  EXPECT_TRUE(consistent_turns({}).empty());
}

TEST(ConsistentTurns, DropsMatchesThatDisagree) {
  Features a, b;
  a.points.resize(40);
  b.points.resize(40);
  std::vector<FeatureMatch> matches;
  for (std::uint16_t i = 0; i < 40; ++i) {
    a.points[i].angle = 0.15f * static_cast<float>(i);
    b.points[i].angle = std::fmod(a.points[i].angle + (i == 5 ? 4.0f : 0.5f), 6.2831853f);
    matches.push_back({i, i, 0});
  }
  keep_consistent_turns(a, b, matches);
  EXPECT_EQ(matches.size(), 39u);
  for (const FeatureMatch& m : matches) EXPECT_NE(m.a, 5);
}

}  // namespace
}  // namespace cairn
