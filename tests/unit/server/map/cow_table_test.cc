#include "server/map/cow_table.h"

#include <future>
#include <random>
#include <string>
#include <thread>
#include <unordered_map>

#include <gtest/gtest.h>

#include "server/map/map.h"

namespace cairn {
namespace {

using Table = CowTable<LandmarkId, std::string>;
LandmarkId key(std::uint64_t number) {
  return {LandmarkId::kServer, number};
}

TEST(CowTable, ACopyKeepsWhatTheOriginalChanges) {
  Table table;
  table.insert(key(1), "one");
  table.insert(key(2), "two");
  const Table copy = table;
  *table.edit(key(1)) = "uno";
  table.erase(key(2));
  table.insert(key(3), "three");
  EXPECT_EQ(copy.at(key(1)), "one");
  EXPECT_EQ(copy.at(key(2)), "two");
  EXPECT_FALSE(copy.contains(key(3)));
  EXPECT_EQ(copy.size(), 2u);
  EXPECT_EQ(table.at(key(1)), "uno");
  EXPECT_EQ(table.sorted_keys(), (std::vector<LandmarkId>{key(1), key(3)}));
}

TEST(CowTable, TheOriginalKeepsWhatACopyChanges) {
  Table table;
  table.insert(key(1), "one");
  Table copy = table;
  *copy.edit(key(1)) = "uno";
  EXPECT_EQ(table.at(key(1)), "one");
}

TEST(CowTable, SharesValuesUntilTheyAreChanged) {
  Table table;
  table.insert(key(1), "one");
  table.insert(key(2), "two");
  const Table copy = table;
  *table.edit(key(1)) = "uno";
  EXPECT_NE(table.find(key(1)), copy.find(key(1)));
  EXPECT_EQ(table.find(key(2)), copy.find(key(2)));
  const std::string* mine = table.find(key(1));
  EXPECT_EQ(table.edit(key(1)), mine);  // no longer shared: changed in place
}

TEST(CowTable, DoesAsAnOrdinaryTableDoes) {
  std::mt19937_64 random(5);
  Table table;
  std::unordered_map<LandmarkId, std::string> expected;
  std::vector<std::pair<Table, std::size_t>> copies;
  for (int i = 0; i < 5000; ++i) {
    const LandmarkId k = key(random() % 700);
    const std::string value = std::to_string(i);
    switch (random() % 4) {
      case 0:
        EXPECT_EQ(table.erase(k), expected.erase(k) == 1);
        break;
      case 1:
        if (std::string* found = table.edit(k)) {
          ASSERT_TRUE(expected.contains(k));
          *found = expected[k] = value;
        }
        break;
      default:
        table.insert(k, value);
        expected[k] = value;
    }
    if (i % 500 == 0) copies.emplace_back(table, expected.size());
  }
  EXPECT_EQ(table.size(), expected.size());
  table.for_each([&](const LandmarkId& k, const std::string& v) { EXPECT_EQ(expected[k], v); });
  for (const auto& [copy, size] : copies) EXPECT_EQ(copy.sorted_keys().size(), size);
}

// Under ThreadSanitizer this shows that letting go of a copy orders its reads before the original's
// next change in place.
TEST(CowTable, CopiesAreReadOnOtherThreadsWhileTheOriginalChanges) {
  Table table;
  for (std::uint64_t i = 0; i < 300; ++i) table.insert(key(i), "0");
  std::vector<std::future<bool>> readers;
  for (int round = 0; round < 60; ++round) {
    readers.push_back(std::async(std::launch::async, [copy = Table(table)]() mutable {
      bool alike = true;
      const std::string first = copy.at(key(0));
      copy.for_each([&](const LandmarkId&, const std::string& v) { alike &= v == first; });
      copy = Table();  // may be the last but one owner
      return alike;
    }));
    for (std::uint64_t i = 0; i < 300; ++i) *table.edit(key(i)) = std::to_string(round);
  }
  for (auto& reader : readers) EXPECT_TRUE(reader.get());
}

}  // namespace
}  // namespace cairn
