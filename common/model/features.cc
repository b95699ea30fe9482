#include "common/model/features.h"

#include <cmath>

namespace cairn {

double ScalePyramid::scale(int octave) const {
  return std::pow(static_cast<double>(factor), octave);
}

double ScalePyramid::variance(int octave) const {
  const double s = scale(octave);
  return s * s;
}

}  // namespace cairn
