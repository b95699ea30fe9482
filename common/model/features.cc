#include "common/model/features.h"

#include <cmath>

namespace cairn {

double ScalePyramid::scale(int octave) const {
  return std::pow(static_cast<double>(factor), octave);
}

double ScalePyramid::sigma(int octave) const {
  constexpr double kExponent = 0.7;
  return std::pow(static_cast<double>(factor), kExponent * octave);
}

}  // namespace cairn
