// Information entropy of image blocks, and the threshold under which a block is sharpened.
//
// Source: Luo et al. 2020, "Improved ORB-SLAM2 Algorithm Based on Information Entropy and Image
// Sharpening Adjustment", doi 10.1155/2020/4724310.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/kernels.h"

namespace cairn {

enum class EntropyVariant {
  kHistogram,  // eq. 9: of the distribution of grey levels; 0 (flat) to 8 bits
  kShares,     // eqs. 10-11: of each pixel's share in the block's sum of grey levels; 0 to
               // log2(pixels) bits. Ordinary blocks all lie near the upper end.
};

// Entropy of the whole of `block` (CV_8UC1, at most 65535 columns) in bits.
double entropy(const cv::Mat& block, EntropyVariant variant,
               const Kernels& kernels = best_kernels());

// How an image is cut into blocks: as many of about `block` pixels a side as fit, of equal size but
// for rounding, so that no slivers remain at the borders whose entropy would be low for lack of
// pixels.
class BlockGrid {
 public:
  BlockGrid(cv::Size image, int block);
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  int size() const { return columns_ * rows_; }
  cv::Rect area(int index) const;  // row by row
  int at(int x, int y) const;      // the index of the block that the pixel lies in

 private:
  cv::Size image_;
  int columns_, rows_;
};

// Appends the entropy of every block of `image`, in the order of `grid`.
void append_block_entropies(const cv::Mat& image, const BlockGrid& grid, EntropyVariant variant,
                            std::vector<float>& entropies, const Kernels& kernels = best_kernels());

enum class EntropyMode {
  kOff,         // nothing is sharpened: plain ORB
  kOnline,      // H_ave is the running mean over the images seen so far, this one included
  kCalibrated,  // H_ave was found in a first pass over the scene
  kFixed,       // E0 itself is given
};

struct EntropyOptions {
  EntropyMode mode = EntropyMode::kOnline;
  EntropyVariant variant = EntropyVariant::kHistogram;
  int block = 64;         // pixels a side, on every level
  double delta = 0.3;     // bits
  double scene_mean = 0;  // kCalibrated: H_ave in bits, EntropyThreshold::mean() of a first pass
  double fixed_threshold = 0;  // kFixed: E0 in bits
  // Least E0 on levels of an image where E0 leaves too few corners, in the modes online and
  // calibrated, bits. Eq. 12 sets E0 relative to the scene: where all of it is weak, hardly any
  // block lies below, although little can be tracked there without sharpening. On other levels the
  // bound does harm: faint corners of flat walls are matched worse and located worse than others.
  // 0: eq. 12 as it stands, and no search for fainter corners (FastOptions::fill_threshold) either.
  double min_threshold = 3;

  // Of levels that lack corners; 0: nothing more is done for them.
  double threshold_to_fill() const {
    return mode == EntropyMode::kOnline || mode == EntropyMode::kCalibrated ? min_threshold : 0;
  }
};

// E0 = H_ave / 2 + delta (eq. 12), H_ave being the mean entropy of the scene's blocks.
class EntropyThreshold {
 public:
  explicit EntropyThreshold(const EntropyOptions& options) : options_(options) {}

  // Takes the mean entropy of the next image's blocks, returns E0 (bits) for that image. Blocks
  // with E < E0 are to be sharpened; 0, so none, when the mode is off.
  double next(double image_mean);

  // H_ave so far: the mean of what next() was given.
  double mean() const { return mean_; }

 private:
  EntropyOptions options_;
  double mean_ = 0;
  long images_ = 0;
};

}  // namespace cairn
