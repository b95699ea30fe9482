// Image -> features: the improved ORB of Luo et al. 2020 (doi 10.1155/2020/4724310).
//
// Pyramid; sharpening of blocks of low entropy; FAST corners spread by a quadtree; orientation by
// the intensity centroid; steered BRIEF. See the headers of the steps.
//
// Three things are done otherwise than in the paper, all because they raise the matches (figures in
// tests/bench/RESULTS.md); as_in_paper() gives the paper's own way:
// - A level with fewer corners than it and the finer ones need is searched once more, with more of
//   its blocks sharpened and for fainter corners everywhere, and filled up with what that shows.
//   That is what E0, relative to the scene, leaves out where all of it is weak. Done always, it
//   costs time and harms.
// - Corners in sharpened blocks only fill up what corners elsewhere leave free in a search. Found
//   among noise, they are matched a tenth as often; as equals they would displace good ones,
//   because the quadtree spreads features evenly. On levels where strong corners alone suffice,
//   faint ones are left out for the same reason.
// - Sharpening serves to find corners. Orientation and descriptor come from the pixels as they were
//   taken: sharpening amplifies their noise.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/corner.h"
#include "client/frontend/describe.h"
#include "client/frontend/entropy.h"
#include "client/frontend/fast.h"
#include "client/frontend/kernels.h"
#include "client/frontend/pyramid.h"
#include "client/frontend/quadtree.h"
#include "common/model/features.h"

namespace cairn {

struct ExtractorOptions {
  int features = 1000;  // at most that many
  ScalePyramid pyramid = {};
  FastOptions fast = {};
  EntropyOptions entropy = {};
  bool best_first = true;           // corners in sharpened blocks, and faint ones, come last
  bool describe_sharpened = false;  // orientation and descriptor too are of sharpened pixels
};

// The same with sharpening just as published: eq. 12 alone, no second search of levels that lack
// corners, all corners alike, described on sharpened pixels.
ExtractorOptions as_in_paper(ExtractorOptions options);

// Of the last image.
struct ExtractorStats {
  // Milliseconds on the extractor's thread.
  double pyramid_ms = 0, entropy_ms = 0, sharpen_ms = 0, fast_ms = 0, quadtree_ms = 0;
  double orient_ms = 0 /* and sub-pixel position */, smooth_ms = 0, describe_ms = 0;
  double total_ms = 0;
  int corners = 0;  // candidates of all searches, before the quadtree
  int blocks = 0;   // on all levels
  int blocks_sharpened = 0;
  double image_entropy = 0;  // mean over all blocks, bits
  double threshold = 0;      // E0 of each level's first search, bits
};

// Used from one thread. The same images in the same order give the same features; with the entropy
// mode `online` E0 depends on the images seen before. Memory is reused: nothing of its own is
// allocated once the image size is known.
class Extractor {
 public:
  // `kernels` are for tests: the features are the same with any.
  explicit Extractor(const ExtractorOptions& options, const Kernels& kernels = best_kernels());

  // Replaces `out` by the features of `gray` (CV_8UC1): positions in pixels of that image, lens
  // distortion included; disparity 0; level by level, the finest first. None when the image is
  // empty or of another type.
  void extract(const cv::Mat& gray, Features& out);

  const ExtractorStats& stats() const { return stats_; }
  // H_ave over the images so far, bits: what EntropyOptions::scene_mean wants.
  double scene_entropy() const { return threshold_.mean(); }
  // Of the last image, not sharpened.
  const Pyramid& pyramid() const { return pyramid_; }

 private:
  void measure_entropy();
  cv::Mat find_features(int level, int wanted, Features& out);
  cv::Mat add_features(int level, double least_entropy, int low_threshold, int wanted,
                       Features& out);
  cv::Mat sharpen_blocks(int level, double least_entropy);
  void leave_out_found(const cv::Size& size);
  void choose_corners(int level, int wanted);
  void choose_best_first(int level, const cv::Rect& area, int wanted);
  void describe(int level, const cv::Mat& image, std::size_t first, Features& out);

  ExtractorOptions options_;
  const Kernels* kernels_;
  Pyramid pyramid_;
  // Of the level at hand, in the size of the finest; occupied: not 0 around what has been found.
  cv::Mat sharpened_, smoothed_, occupied_;
  EntropyThreshold threshold_;
  FastDetector fast_;
  Quadtree quadtree_;
  Describer describer_;
  ExtractorStats stats_;

  std::vector<std::vector<float>> entropies_;  // of each level's blocks
  // Of the level at hand.
  std::vector<std::uint8_t> sharpened_blocks_;   // 1 for those sharpened in the last search
  std::vector<Corner> corners_, chosen_, more_;  // of the last search
  std::vector<Corner> found_;                    // chosen in any search
  std::vector<std::uint16_t> blur_line_;
};

}  // namespace cairn
