#include "common/model/measurement_noise.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(KeyframeNoise, GrowsWithTheErrorAndStaysInBounds) {
  EXPECT_FLOAT_EQ(keyframe_noise(0.35), 1);
  EXPECT_NEAR(keyframe_noise(3.5), 2.24, 0.01);  // 10^0.35
  EXPECT_EQ(keyframe_noise(0), kMinNoise);
  EXPECT_EQ(keyframe_noise(1e6), kMaxNoise);
}

TEST(MeasurementSigma, OfAKeyframeIsItsNoiseTimesTheUsual) {
  Keyframe keyframe;
  keyframe.rig = std::make_shared<Rig>();
  Feature feature;
  feature.octave = 2;
  const MeasurementSigma usual = measurement_sigma(*keyframe.rig, feature);
  keyframe.noise = 3;
  EXPECT_NEAR(measurement_sigma(keyframe, feature).pixel, 3 * usual.pixel, 1e-6);
  EXPECT_NEAR(measurement_sigma(keyframe, feature).disparity, 3 * usual.disparity, 1e-6);
}

}  // namespace
}  // namespace cairn
