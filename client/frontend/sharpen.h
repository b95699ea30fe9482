// Sharpening of image blocks (Luo et al. 2020, eq. 8).
#pragma once

#include <opencv2/core/mat.hpp>

#include "client/frontend/kernels.h"

namespace cairn {

// Writes to out(area) the pixels of in(area) convolved with [0 -1 0; -1 5 -1; 0 -1 0], clamped to
// 0..255. Neighbours are read from `in`, also those outside `area`, so that adjoining sharpened
// blocks show no seam; beyond the image the border pixel is repeated. Both are CV_8UC1, of the same
// size, and must not overlap in memory.
void sharpen(const cv::Mat& in, const cv::Rect& area, cv::Mat& out,
             const Kernels& kernels = best_kernels());

}  // namespace cairn
