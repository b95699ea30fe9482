#include "common/model/features.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(ScalePyramid, ScaleGrowsByTheFactorAndSigmaSlower) {
  const ScalePyramid pyramid{.factor = 2, .levels = 4};
  EXPECT_DOUBLE_EQ(pyramid.scale(0), 1);
  EXPECT_DOUBLE_EQ(pyramid.scale(3), 8);
  EXPECT_DOUBLE_EQ(pyramid.sigma(0), 1);
  EXPECT_GT(pyramid.sigma(3), pyramid.sigma(2));
  EXPECT_LT(pyramid.sigma(3), 0.9 * pyramid.scale(3));
}

TEST(Feature, DepthIsKnownWhenThereIsADisparity) {
  EXPECT_FALSE(Feature{}.has_depth());
  EXPECT_TRUE((Feature{.disparity = 0.5f}).has_depth());
}

}  // namespace
}  // namespace cairn
