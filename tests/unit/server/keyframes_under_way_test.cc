#include "server/keyframes_under_way.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

const ClientId kWalker{"walker", 7}, kOther{"other", 8};

TEST(KeyframesUnderWay, EachIsTakenOnce) {
  KeyframesUnderWay under_way;
  under_way.add({7, 0}, {kWalker, {}, true});
  EXPECT_EQ(under_way.client_of({7, 0}), kWalker);
  const auto entry = under_way.take({7, 0});
  ASSERT_TRUE(entry);
  EXPECT_EQ(entry->client, kWalker);
  EXPECT_TRUE(entry->counts);
  EXPECT_FALSE(under_way.take({7, 0}));
  EXPECT_FALSE(under_way.client_of({7, 0}));
}

TEST(KeyframesUnderWay, ARunIsFinishedOnceItsLastOneIsThrough) {
  KeyframesUnderWay under_way;
  under_way.add({7, 0}, {kWalker, {}, true});
  under_way.add({7, 1}, {kWalker, {}, true});
  under_way.add({8, 0}, {kOther, {}, true});
  EXPECT_TRUE(under_way.finish_later(7));
  EXPECT_FALSE(under_way.finished(7));
  under_way.take({7, 1});
  EXPECT_FALSE(under_way.finished(7));
  under_way.take({7, 0});
  EXPECT_TRUE(under_way.finished(7));
  EXPECT_FALSE(under_way.finished(7)) << "said once";
}

TEST(KeyframesUnderWay, ARunWithNothingUnderWayNeedNotWait) {
  KeyframesUnderWay under_way;
  under_way.add({8, 0}, {kOther, {}, true});
  EXPECT_FALSE(under_way.finish_later(7));
  EXPECT_FALSE(under_way.finished(7)) << "it was never told to wait";
}

}  // namespace
}  // namespace cairn
