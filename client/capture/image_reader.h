// Reads images from files and checks them against the camera. Errors are one line that names the
// file.
#pragma once

#include <filesystem>

#include <opencv2/core/mat.hpp>

#include "common/util/status.h"

namespace cairn {

// Any image format, colour or grey, as CV_8UC1. Error when unreadable or not of the size `expected`
// (0 x 0: any).
Result<cv::Mat> read_gray(const std::filesystem::path& file, cv::Size expected);

// A depth image (16-bit, or float TIFF) as CV_32FC1 metres, 0 where unknown: value / `depth_scale`.
Result<cv::Mat> read_depth(const std::filesystem::path& file, cv::Size expected,
                           double depth_scale);

}  // namespace cairn
