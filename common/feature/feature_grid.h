// Index of an image's features by position, for searches around a predicted pixel.
#pragma once

#include <cstdint>
#include <vector>

#include "common/geometry/camera.h"
#include "common/model/features.h"

namespace cairn {

// Immutable after construction; safe to read from several threads. Does not keep `features`: the
// indices that it returns refer to them.
class FeatureGrid {
 public:
  // The cells cover the image and a margin of a quarter of it: undistorted features may lie
  // outside.
  FeatureGrid(const Features& features, const PinholeCamera& camera);

  // Appends to `found` the indices of features within a square of half side `radius` (pixels)
  // around (x, y), with min_octave <= octave <= max_octave. The order is that of the cells, then of
  // the features: the same on every run.
  void search(float x, float y, float radius, int min_octave, int max_octave,
              std::vector<std::uint16_t>& found) const;

 private:
  struct Entry {
    float x, y;
    std::uint16_t index;
    std::uint8_t octave;
  };
  int column(float x) const;
  int row(float y) const;

  float left_, top_;  // pixel position of the first cell's corner
  int columns_ = 0, rows_ = 0;
  std::vector<Entry> entries_;         // sorted by cell
  std::vector<std::uint32_t> starts_;  // first entry of each cell, and one past the last
};

}  // namespace cairn
