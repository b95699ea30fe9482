// Procedural pictures for the surfaces of a synthetic world.
//
// They have what real surfaces have and corner detectors feed on: structure at all scales (fractal
// noise, shapes whose sizes follow the power law of the "dead leaves" model: Lee, Mumford, Huang
// 2001, "Occlusion models for natural images"), sharp borders, text-like marks, and plain areas
// between them.
//
// All give CV_32FC1 grey levels, for a surface of `area` at its pixel density. Deterministic by the
// generator's state. Lengths in metres, contrast in grey levels.
#pragma once

#include <algorithm>

#include <opencv2/core/mat.hpp>

#include "tests/support/random.h"

namespace cairn::synthetic::paint {

struct Area {
  double width = 1, height = 1;  // metres
  double pixels_per_metre = 256;

  int columns() const { return std::max(2, static_cast<int>(width * pixels_per_metre + 0.5)); }
  int rows() const { return std::max(2, static_cast<int>(height * pixels_per_metre + 0.5)); }
};

// Fractal noise: mean 0, standard deviation 1, octaves from `coarsest` metres down to a pixel;
// each finer octave has `persistence` times the amplitude of the one above.
cv::Mat fractal(Random& random, const Area& area, double coarsest, double persistence);

// A painted wall: one level, a slow drift of light, faint grain, a few stains and scratches.
cv::Mat plaster(Random& random, const Area& area, double level, double contrast);
// Shapes upon shapes, from 3 cm to half the area's height: the richest of the pictures.
cv::Mat leaves(Random& random, const Area& area, double level, double contrast);
// A framed picture with a caption.
cv::Mat poster(Random& random, const Area& area);
// A printed page: lines of glyph-like strokes on paper.
cv::Mat page(Random& random, const Area& area);
// A shelf's front: book backs with titles, shelf boards between.
cv::Mat books(Random& random, const Area& area);
cv::Mat boards(Random& random, const Area& area, double level);  // a floor or table of wood
cv::Mat carpet(Random& random, const Area& area, double level, double contrast);
cv::Mat keyboard(Random& random, const Area& area);
// A dark screen in a frame, with a few windows of text.
cv::Mat screen(Random& random, const Area& area);
// Brickwork: every brick alike but for a slight difference of tone.
cv::Mat bricks(Random& random, const Area& area);
// Almost nothing: shapes, dots and lines that differ from the ground by at most `contrast`.
cv::Mat faint(Random& random, const Area& area, double level, double contrast);

}  // namespace cairn::synthetic::paint
