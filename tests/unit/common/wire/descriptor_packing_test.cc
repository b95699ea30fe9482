#include "common/wire/descriptor_packing.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "common/wire/descriptor_statistics.h"

namespace cairn::wire {
namespace {

std::vector<Descriptor> random_descriptors(std::size_t count, std::uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  std::vector<Descriptor> all(count);
  for (Descriptor& d : all)
    for (std::uint64_t& word : d) word = random();
  return all;
}

// As the statistics say that they are.
std::vector<Descriptor> typical_descriptors(std::size_t count) {
  std::mt19937_64 random(2);
  std::vector<Descriptor> all(count);
  for (Descriptor& d : all) {
    const auto is_set = [&](std::uint8_t bit) { return d[bit / 64] >> (bit % 64) & 1; };
    for (const DescriptorBit& b : kDescriptorBits)
      if (random() % 4096 < b.chance[2 * is_set(b.first) + is_set(b.second)])
        d[b.bit / 64] |= std::uint64_t{1} << (b.bit % 64);
  }
  return all;
}

std::optional<std::vector<Descriptor>> unpacked(Bytes packed, std::size_t count) {
  std::vector<Descriptor> all(count);
  if (!unpack_descriptors(packed, all)) return std::nullopt;
  return all;
}

TEST(DescriptorPacking, KeepsEveryBitOfAnyNumber) {
  for (const std::size_t count : {0u, 1u, 2u, 3u, 4u, 5u, 100u, 1001u}) {
    const auto all = random_descriptors(count);
    EXPECT_EQ(unpacked(pack_descriptors(all), count), all) << count;
  }
  const std::vector<Descriptor> extremes{{0, 0, 0, 0}, {~0ull, ~0ull, ~0ull, ~0ull}};
  EXPECT_EQ(unpacked(pack_descriptors(extremes), 2), extremes);
}

TEST(DescriptorPacking, TakesAQuarterLessOfWhatLooksLikePhotographs) {
  const auto all = typical_descriptors(500);
  const Blob packed = pack_descriptors(all);
  EXPECT_EQ(unpacked(packed, 500), all);
  EXPECT_LT(packed.size(), 500u * 32 * 80 / 100);
  // What looks like nothing of the kind takes more.
  EXPECT_LT(pack_descriptors(random_descriptors(500)).size(), 500u * 40);
}

TEST(DescriptorPacking, NoticesBytesThatAreMissingLeftOrChanged) {
  const auto all = random_descriptors(9);
  Blob packed = pack_descriptors(all);
  EXPECT_FALSE(unpacked(packed, 8));
  EXPECT_FALSE(unpacked(packed, 10));
  for (std::size_t size = 0; size < packed.size(); ++size)
    EXPECT_FALSE(unpacked(Bytes(packed).first(size), 9)) << size;
  Blob longer = packed;
  longer.push_back(0);
  longer.push_back(0);
  EXPECT_FALSE(unpacked(longer, 9));
  // What does unpack packs to itself again.
  for (std::size_t bit = 0; bit < 8 * packed.size(); ++bit) {
    packed[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
    if (const auto got = unpacked(packed, 9)) {
      EXPECT_EQ(pack_descriptors(*got), packed) << bit;
    }
    packed[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
  }
}

TEST(DescriptorStatistics, NameEachBitOnceAndWhatItFollowsBefore) {
  std::set<int> known;
  for (const DescriptorBit& b : kDescriptorBits) {
    if (!known.empty()) {
      EXPECT_TRUE(known.contains(b.first) && known.contains(b.second)) << int{b.bit};
    }
    EXPECT_TRUE(known.insert(b.bit).second);
    for (const std::uint16_t chance : b.chance) {
      EXPECT_GT(chance, 0);
      EXPECT_LT(chance, 1 << kChanceBits);
    }
  }
  EXPECT_EQ(known.size(), 256u);
}

}  // namespace
}  // namespace cairn::wire
