// Statistics that tell natural images from artificial ones.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

namespace cairn::synthetic {

// Entropy of each whole block of `side` x `side` pixels of a CV_8UC1 image: H = -sum p log2 p over
// the 256-bin histogram, bits; blocks in reading order.
std::vector<double> block_entropies(const cv::Mat& gray, int side = 32);

// The value below which `share` (0..1) of the values lie. Needs at least one value.
double percentile(std::vector<double> values, double share);

}  // namespace cairn::synthetic
