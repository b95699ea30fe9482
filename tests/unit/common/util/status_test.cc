#include "common/util/status.h"

#include <memory>

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(Status, IsFineUnlessItHoldsAnError) {
  EXPECT_TRUE(Status().ok());
  const Status bad(ErrorCode::kTimeout, "no answer within 5 s");
  EXPECT_FALSE(bad.ok());
  EXPECT_FALSE(static_cast<bool>(bad));
  EXPECT_EQ(bad.error().code, ErrorCode::kTimeout);
  EXPECT_EQ(bad.message(), "no answer within 5 s");
}

TEST(Result, HoldsAValueOrAnError) {
  const auto half = [](int x) -> Result<int> {
    if (x % 2) return Error{ErrorCode::kInvalidArgument, "odd"};
    return x / 2;
  };
  EXPECT_EQ(*half(8), 4);
  ASSERT_FALSE(half(7).ok());
  EXPECT_EQ(half(7).message(), "odd");
}

TEST(Result, HandsOnErrorsOfOtherTypes) {
  const Result<int> inner(ErrorCode::kNotFound, "gone");
  const Result<std::string> outer = inner.error();
  EXPECT_EQ(outer.error().code, ErrorCode::kNotFound);
  const Status status = inner.error();
  EXPECT_EQ(status.message(), "gone");
}

TEST(Result, MovesWhatCannotBeCopied) {
  Result<std::unique_ptr<int>> result(std::make_unique<int>(3));
  const std::unique_ptr<int> taken = std::move(*result);
  EXPECT_EQ(*taken, 3);
}

}  // namespace
}  // namespace cairn
