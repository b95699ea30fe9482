#include "server/map/covisibility_changes.h"

#include <gmock/gmock.h>

#include <map>

#include "server/map/map.h"

namespace cairn {
namespace {

using Table = std::map<KeyframeId, std::vector<std::pair<KeyframeId, int>>>;

Table taken(CovisibilityChanges& changes) {
  Table table;
  changes.take([&](KeyframeId id, const auto& list) { table[id] = list; });
  return table;
}

constexpr KeyframeId kA{1, 0}, kB{1, 1}, kC{2, 0};

TEST(CovisibilityChanges, CountsBothWaysAndNotWithItself) {
  CovisibilityChanges changes;
  changes.add(kC, std::vector<Observation>{{kA, 3}, {kC, 4}, {kB, 5}}, +1);
  changes.add(kC, std::vector<Observation>{{kA, 7}}, +1);
  EXPECT_EQ(taken(changes), (Table{{kA, {{kC, 2}}}, {kB, {{kC, 1}}}, {kC, {{kA, 2}, {kB, 1}}}}));
}

TEST(CovisibilityChanges, WhatIsTakenBackIsNoChange) {
  CovisibilityChanges changes;
  changes.add(kA, std::vector<Observation>{{kB, 0}, {kC, 0}}, +1);
  changes.add(kB, std::vector<Observation>{{kA, 0}}, -1);
  EXPECT_EQ(taken(changes), (Table{{kA, {{kC, 1}}}, {kC, {{kA, 1}}}}));
}

TEST(CovisibilityChanges, StartsAnewOnceTaken) {
  CovisibilityChanges changes;
  changes.add(kA, std::vector<Observation>{{kB, 0}}, +1);
  EXPECT_EQ(taken(changes).size(), 2u);
  EXPECT_TRUE(taken(changes).empty());
  changes.add(kC, std::vector<Observation>{{kB, 0}}, -1);
  EXPECT_EQ(taken(changes), (Table{{kB, {{kC, -1}}}, {kC, {{kB, -1}}}}));
}

}  // namespace
}  // namespace cairn
