#include "client/capture/image_reader.h"

#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace cairn {
namespace {

Result<cv::Mat> read(const std::filesystem::path& file, cv::Size expected, int flags) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(file, error);
  if (error) return {ErrorCode::kNotFound, file.string() + ": " + error.message()};
  cv::Mat image;
  if (bytes > 0) {
    try {
      image = cv::imread(file.string(), flags);
    } catch (const cv::Exception&) {
      image.release();
    }
  }
  if (image.empty()) return {ErrorCode::kCorrupt, file.string() + ": is no readable image"};
  if (expected.area() > 0 && image.size() != expected) {
    return {ErrorCode::kInvalidArgument, file.string() + ": is " + std::to_string(image.cols) +
                                             "x" + std::to_string(image.rows) + ", the camera " +
                                             std::to_string(expected.width) + "x" +
                                             std::to_string(expected.height)};
  }
  return image;
}

}  // namespace

Result<cv::Mat> read_gray(const std::filesystem::path& file, cv::Size expected) {
  return read(file, expected, cv::IMREAD_GRAYSCALE);
}

Result<cv::Mat> read_depth(const std::filesystem::path& file, cv::Size expected,
                           double depth_scale) {
  auto image = read(file, expected, cv::IMREAD_UNCHANGED);
  if (!image) return image;
  if (image->type() != CV_16UC1 && image->type() != CV_32FC1) {
    return {ErrorCode::kCorrupt, file.string() + ": is no depth image (16 bits, one channel)"};
  }
  cv::Mat metres;
  image->convertTo(metres, CV_32F, 1.0 / depth_scale);
  if (image->type() == CV_32FC1) cv::patchNaNs(metres, 0);
  return metres;
}

}  // namespace cairn
