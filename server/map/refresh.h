// What follows from a landmark's observations: descriptor, viewing direction, scale range. Each
// function reads the landmark's position and observations and the keyframes of the map.
#pragma once

#include "server/map/map.h"

namespace cairn {

// The descriptor among the observed ones with the least median Hamming distance to the others. Of
// many observations the latest kMaxCompared count.
void refresh_descriptor(const Map& map, Landmark& landmark);

// normal: mean of the unit directions from the landmark to the cameras.
// max_distance: at which the feature of the reference keyframe would show at octave 0:
//   |position - camera| * scale(octave); min_distance: at which it would show at the last octave.
// Exact figures, without margins: whoever predicts visibility allows [0.8 min, 1.2 max].
void refresh_geometry(const Map& map, Landmark& landmark);

// The octave at which a landmark shows at `distance` (metres), within the pyramid.
int predicted_octave(const Landmark& landmark, double distance, const ScalePyramid& pyramid);

}  // namespace cairn
