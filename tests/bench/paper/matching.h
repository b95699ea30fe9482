// How many features of two views find each other, with and without the paper's steps: its table 1
// and figure 12.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/extractor.h"
#include "tests/bench/paper/views.h"

namespace cairn::bench {

struct Method {
  std::string name;
  ExtractorOptions extractor;
  // Features in blocks whose entropy lies below the threshold are left out, and nothing is
  // sharpened: what the paper's entropy does by itself. The paper doesn't say what its row "ORB and
  // entropy" does with such blocks; this is our reading.
  bool leave_out_poor_blocks = false;
};
// Of ExtractorOptions with and without sharpening: plain ORB; with entropy; with the choice of
// corners that goes with sharpening, yet nothing sharpened; with all of it.
std::vector<Method> methods(const ExtractorOptions& off, const ExtractorOptions& on);

struct PairMatches {
  double key_points = 0;  // mean of the two views
  int matches = 0;        // mutual nearest by descriptor
  int inliers = 0;        // of these, after RANSAC on the fundamental matrix
  int correct = 0;        // of the inliers, those that the truth confirms
  double rate() const { return matches > 0 ? static_cast<double>(inliers) / matches : 0; }
};

struct MatchingResult {
  std::vector<PairMatches> pairs;     // as ViewSet::pairs
  std::vector<double> extraction_ms;  // of each view
};

// Extracts all views in their order (the threshold adapts to what was seen before), matches all
// pairs.
MatchingResult match_views(const ViewSet& set, const Method& method);

// The matches of one pair, drawn: inliers bright, the rest of the matches dark, one picture below
// the other for several methods.
cv::Mat draw_pair(const ViewSet& set, std::size_t pair, const std::vector<Method>& methods);

}  // namespace cairn::bench
