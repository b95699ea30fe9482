// A photograph and the same seen by another camera: pairs whose correspondences are known.
#pragma once

#include <cstdint>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace cairn::bench {

struct Warp {
  double max_turn = M_PI;       // radians to either side
  double max_log_scale = 0.22;  // natural logarithm of the scale, to either side
  double max_tilt = 1e-4;       // perspective, 1 / pixels
  double noise = 3;             // grey levels, standard deviation
  double max_blur = 0.8;        // pixels, standard deviation
};

struct WarpedPair {
  cv::Mat original, warped;  // CV_8UC1, same size
  cv::Matx33d warped_from_original;

  cv::Point2d map(cv::Point2d p) const {
    const cv::Vec3d q = warped_from_original * cv::Vec3d(p.x, p.y, 1);
    return {q[0] / q[2], q[1] / q[2]};
  }
};

// Adds noise to both images, other brightness and blur to the warped one.
inline WarpedPair warp(const cv::Mat& photo, const Warp& options, std::uint64_t seed) {
  cv::RNG rng(seed * 7919 + 17);
  const double cx = photo.cols / 2.0, cy = photo.rows / 2.0;
  const double turn = rng.uniform(-options.max_turn, options.max_turn);
  const double scale = std::exp(rng.uniform(-options.max_log_scale, options.max_log_scale));
  const double c = scale * std::cos(turn), s = scale * std::sin(turn);
  const cv::Matx33d to_centre(1, 0, -cx, 0, 1, -cy, 0, 0, 1), back(1, 0, cx, 0, 1, cy, 0, 0, 1);
  const cv::Matx33d about_centre(c, -s, rng.uniform(-10.0, 10.0), s, c, rng.uniform(-10.0, 10.0),
                                 rng.uniform(-options.max_tilt, options.max_tilt),
                                 rng.uniform(-options.max_tilt, options.max_tilt), 1);
  WarpedPair pair;
  pair.warped_from_original = back * about_centre * to_centre;
  cv::warpPerspective(photo, pair.warped, pair.warped_from_original, photo.size(), cv::INTER_LINEAR,
                      cv::BORDER_REFLECT_101);
  cv::GaussianBlur(pair.warped, pair.warped, {5, 5}, rng.uniform(0.1, options.max_blur));
  pair.warped.convertTo(pair.warped, CV_8U, rng.uniform(0.8, 1.2), rng.uniform(-20.0, 20.0));
  const auto noisy = [&](const cv::Mat& image) {
    cv::Mat noise(image.size(), CV_16SC1), out;
    rng.fill(noise, cv::RNG::NORMAL, 0, options.noise);
    cv::add(image, noise, out, cv::noArray(), CV_8U);
    return out;
  };
  pair.original = noisy(photo);
  pair.warped = noisy(pair.warped);
  return pair;
}

}  // namespace cairn::bench
