// Orientation of a corner by the intensity centroid (Rublee et al. 2011, section 3.2).
#pragma once

#include <opencv2/core/mat.hpp>

#include "client/frontend/kernels.h"

namespace cairn {

// Corners must keep this many pixels from the image's edges to be oriented and described.
inline constexpr int kPatchBorder = 19;

// Direction from (x, y) to the centroid of the grey levels within 15 pixels, radians in [0, 2 pi),
// clockwise on the image (y down). `image` is CV_8UC1; (x, y) keeps kPatchBorder from its edges.
float orientation(const cv::Mat& image, int x, int y, const Kernels& kernels = best_kernels());

}  // namespace cairn
