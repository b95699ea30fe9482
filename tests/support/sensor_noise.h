// Turns what a perfect sensor would measure into what cameras deliver.
//
// Grey noise of real cameras is weak, grows with brightness, and neighbouring pixels share it
// (demosaicing, in-camera filters): white noise of the same strength would lift the entropy of
// every flat block and make corners of nothing.
#pragma once

#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace cairn::synthetic {

struct GrayNoise {
  double dark = 0.45;    // standard deviation at level 0, grey levels
  double bright = 0.95;  // at level 255
};

// Structured-light depth as of a Kinect. Standard deviation of depth z: base + slope (z - near)^2
// (Nguyen, Izadi, Lovell 2012, "Modeling Kinect sensor noise for improved 3D reconstruction and
// tracking"); disparity comes in steps; surfaces that the projector does not reach, borders of
// depth and surfaces seen at a flat angle give nothing.
struct DepthNoise {
  double base = 0.0012, slope = 0.0019, offset = 0.4;  // metres, 1/metre, metres
  double min_range = 0.4, max_range = 8.0;             // metres
  double projector_baseline = 0.075;                   // metres, projector to the right
  double disparity_step = 0.125;                       // pixels
  double max_slant = 6.0;                              // tangent of the angle to the surface normal
};

// Immutable; safe to use from several threads. `key` names the image: the same seed, key and input
// give the same output, whatever `threads` is.
class SensorNoise {
 public:
  explicit SensorNoise(std::uint64_t seed, const GrayNoise& gray = {},
                       const DepthNoise& depth = {});

  // CV_32FC1 grey levels -> CV_8UC1.
  cv::Mat gray(const cv::Mat& radiance, std::uint64_t key, int threads) const;
  // CV_32FC1 metres -> the same with noise, 0 where the sensor sees nothing. `fx` in pixels.
  cv::Mat depth(const cv::Mat& exact, double fx, std::uint64_t key, int threads) const;

 private:
  // Rows of correlated noise of standard deviation 1, repeating every kTile pixels.
  const float* noise_row(int row, std::uint64_t key) const;
  void depth_row(const cv::Mat& exact, double fx, int row, const float* noise, float* out) const;

  std::uint64_t seed_;
  GrayNoise gray_;
  DepthNoise depth_;
  std::vector<float> tile_;  // kTile rows of 2 * kTile, so that a row can start anywhere
};

// Grey levels rounded and clipped, without noise.
cv::Mat quantised(const cv::Mat& radiance);

}  // namespace cairn::synthetic
