#include "server/publish/byte_budget.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

TEST(ByteBudget, StartsWithAllThatCanBeSaved) {
  ByteBudget budget(100, 500);
  EXPECT_EQ(budget.available(), 500);
  budget.advance(77 * kSecond);  // the first stamp is where the time begins
  EXPECT_EQ(budget.available(), 500);
}

TEST(ByteBudget, GrowsWithTimeUpToALimit) {
  ByteBudget budget(100, 500);
  budget.advance(0);
  budget.spend(450);
  budget.advance(2 * kSecond);
  EXPECT_DOUBLE_EQ(budget.available(), 250);
  budget.advance(60 * kSecond);
  EXPECT_DOUBLE_EQ(budget.available(), 500);
}

TEST(ByteBudget, WhatWasOverspentIsMissingLater) {
  ByteBudget budget(100, 500);
  budget.advance(0);
  budget.spend(900);
  EXPECT_DOUBLE_EQ(budget.available(), -400);
  budget.advance(3 * kSecond);
  EXPECT_DOUBLE_EQ(budget.available(), -100);
}

TEST(ByteBudget, TimeDoesNotRunBackwards) {
  ByteBudget budget(100, 500);
  budget.advance(10 * kSecond);
  budget.spend(500);
  budget.advance(5 * kSecond);
  EXPECT_DOUBLE_EQ(budget.available(), 0);
  budget.advance(11 * kSecond);
  EXPECT_DOUBLE_EQ(budget.available(), 100);
}

}  // namespace
}  // namespace cairn
