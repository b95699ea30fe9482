// How far a feature's measurement may lie from where its landmark projects: the noise that
// tracking, mapping and optimisation weigh residuals with. Searches have bounds of their own.
#pragma once

#include <algorithm>
#include <cmath>

#include "common/model/keyframe.h"

namespace cairn {

// 95 % quantiles of the chi-square distribution: a whitened squared residual above is an outlier.
inline constexpr double kChi2TwoDof = 5.991;    // u, v
inline constexpr double kChi2ThreeDof = 7.815;  // u, v, disparity

// Bounds of Keyframe::noise.
inline constexpr float kMinNoise = 0.4f, kMaxNoise = 4;

// Standard deviations in pixels of u and v, and of the disparity.
struct MeasurementSigma {
  double pixel = 1;
  double disparity = 1;
};

// A stereo disparity is found on the pixels of the feature's octave and is as coarse as they are.
// An RGB-D sensor measures depth apart from the image, so that it is as good for coarse features as
// for fine ones; the rig's virtual baseline makes it one pixel.
inline MeasurementSigma measurement_sigma(const Rig& rig, const Feature& feature) {
  const double pixel = rig.pyramid.sigma(feature.octave);
  return {pixel, rig.sensor == Sensor::kRgbd ? 1.0 : pixel};
}

// The same in a keyframe, some of which are less precise than others as a whole.
inline MeasurementSigma measurement_sigma(const Keyframe& keyframe, const Feature& feature) {
  const MeasurementSigma usual = measurement_sigma(*keyframe.rig, feature);
  return {keyframe.noise * usual.pixel, keyframe.noise * usual.disparity};
}

// Keyframe::noise of an image whose features lie off by `median_squared` (squared distance in
// usual standard deviations, median over the features that show landmarks). Motion blur smears a
// fast turn's keyframes to six times the usual median; taken at full weight they shift the map.
// The exponent is below the 1/2 that noise alone would give because part of the distance is the
// map's own error. Figures by experiment, see tests/bench/RESULTS.md.
inline float keyframe_noise(double median_squared) {
  constexpr double kUsual = 0.35, kExponent = 0.35;
  return std::clamp(static_cast<float>(std::pow(median_squared / kUsual, kExponent)), kMinNoise,
                    kMaxNoise);
}

}  // namespace cairn
