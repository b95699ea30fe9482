// How far a feature's measurement may lie from where its landmark projects: the one noise model that
// tracking, mapping and optimisation weigh residuals with.
#pragma once

#include "common/model/keyframe.h"

namespace cairn {

// 95 % quantiles of the chi-square distribution: a whitened squared residual above is an outlier.
inline constexpr double kChi2TwoDof = 5.991;    // u, v
inline constexpr double kChi2ThreeDof = 7.815;  // u, v, disparity

// Standard deviations in pixels of u and v, and of the disparity, of a feature found at `octave`.
struct MeasurementSigma {
  double pixel = 1;
  double disparity = 1;
};

inline MeasurementSigma measurement_sigma(const Rig& rig, int octave) {
  const double scale = rig.pyramid.scale(octave);
  return {scale, scale};
}

}  // namespace cairn
