// How far a feature's measurement may lie from where its landmark projects: the one noise model
// that tracking, mapping and optimisation weigh residuals with.
#pragma once

#include "common/model/keyframe.h"

namespace cairn {

// 95 % quantiles of the chi-square distribution: a whitened squared residual above is an outlier.
inline constexpr double kChi2TwoDof = 5.991;    // u, v
inline constexpr double kChi2ThreeDof = 7.815;  // u, v, disparity

// Standard deviations in pixels of u and v, and of the disparity.
struct MeasurementSigma {
  double pixel = 1;
  double disparity = 1;
};

// `scale` is that of the octave that the feature was found at. A stereo disparity is found on that
// octave's pixels and is as coarse as they are. An RGB-D sensor measures depth apart from the
// image, so that it is as good for coarse features as for fine ones; the rig's virtual baseline
// makes it one pixel.
inline MeasurementSigma measurement_sigma(const Rig& rig, double scale) {
  return {scale, rig.sensor == Sensor::kRgbd ? 1.0 : scale};
}

}  // namespace cairn
