// Images that the front end's tests share.
#pragma once

#include <filesystem>
#include <string>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace cairn::test {

// Overlapping rectangles and discs of random grey: corners at all scales.
inline cv::Mat textured_image(cv::Size size, int seed, int shapes = 500) {
  cv::RNG rng(static_cast<std::uint64_t>(seed));
  cv::Mat image(size, CV_8UC1, cv::Scalar(120));
  for (int i = 0; i < shapes; ++i) {
    const cv::Point at(rng.uniform(0, size.width), rng.uniform(0, size.height));
    const cv::Scalar gray(rng.uniform(0, 256));
    if (i % 4 == 0)
      cv::circle(image, at, rng.uniform(3, 30), gray, cv::FILLED, cv::LINE_AA);
    else
      cv::rectangle(image, at, at + cv::Point(rng.uniform(4, 60), rng.uniform(4, 60)), gray,
                    cv::FILLED);
  }
  cv::GaussianBlur(image, image, {3, 3}, 0.8);
  return image;
}

inline cv::Mat noise_image(cv::Size size, int seed, int low = 0, int high = 256) {
  cv::Mat image(size, CV_8UC1);
  cv::RNG rng(static_cast<std::uint64_t>(seed));
  rng.fill(image, cv::RNG::UNIFORM, low, high);
  return image;
}

}  // namespace cairn::test
