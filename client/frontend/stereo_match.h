// Disparity of features from a rectified pair.
#pragma once

#include <cstdint>
#include <vector>

#include "client/frontend/pyramid.h"
#include "common/model/features.h"

namespace cairn {

struct StereoOptions {
  int max_distance = 85;  // Hamming, of 256
  float row_band = 2;     // pixels of the right feature's level
  int max_octave_difference = 1;
  float min_disparity = 0.1f;  // pixels: farther away depth says nothing
  float max_disparity = 0;     // pixels; fx * baseline / nearest depth
};

// Used from one thread; keeps scratch memory between calls.
class StereoMatcher {
 public:
  explicit StereoMatcher(const StereoOptions& options) : options_(options) {}

  // Sets the disparity (full-resolution pixels) of those features of `left` whose counterpart is
  // found in `right`: the best descriptor on the same rows and about the same octave, then refined
  // to a fraction of a pixel by comparing windows of the images at the left feature's level.
  // Matches whose windows differ much more than is usual in this pair are dropped. Positions are
  // still in pixels of the images, octaves index the pyramids.
  void match(const Pyramid& left_images, const Pyramid& right_images, const Features& right,
             Features& left);

 private:
  struct Matched {
    std::uint32_t feature;
    float difference;  // of the windows, as a share of contrast
  };
  void sort_by_row(const Pyramid& images, const Features& right);
  int best_candidate(const Feature& point, const Descriptor& descriptor,
                     const Features& right) const;
  void drop_outliers(Features& left);

  StereoOptions options_;
  std::vector<std::uint32_t>
      row_starts_;                     // first entry of each row in by_row_, and one past the last
  std::vector<std::uint32_t> by_row_;  // right features, once for each row that they may match
  std::vector<Matched> matched_;
};

}  // namespace cairn
