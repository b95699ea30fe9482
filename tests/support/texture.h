// A grey picture on a surface, with its mip chain (Williams 1983, "Pyramidal parametrics").
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <opencv2/core/mat.hpp>

namespace cairn::synthetic {

// Immutable once made; read from any thread. Texel (0, 0) covers the first 1/pixels_per_metre
// square of the surface. Values are grey levels times 256: eight bits would turn faint gradients
// into steps.
class Texture {
 public:
  // How a pixel's area falls on the texture: `taps` samples along (step_u, step_v), each filtered
  // by mip level `lod`; in texels of level 0.
  struct Footprint {
    float lod = 0;
    int taps = 1;
    float step_u = 0, step_v = 0;
  };

  Texture() = default;
  // `image`: CV_32FC1, grey levels; clipped to 0..255. At least 2x2.
  Texture(const cv::Mat& image, double pixels_per_metre);

  double pixels_per_metre() const { return pixels_per_metre_; }
  int width() const { return levels_.front().width; }
  int height() const { return levels_.front().height; }

  // The footprint of a pixel whose step to the right moves (a, c) texels and whose step down moves
  // (b, d). Long thin footprints get several taps along their length (at most kMaxTaps), so that
  // floors and corridor walls keep the detail that a camera would see.
  Footprint footprint(float a, float b, float c, float d) const;
  // Grey level at (u, v) texels of level 0, u = 0 being the left border of the surface.
  float sample(float u, float v, const Footprint& footprint) const {
    if (footprint.taps == 1) return trilinear(u, v, footprint.lod);
    float sum = 0;
    const float count = static_cast<float>(footprint.taps);
    for (int i = 0; i < footprint.taps; ++i) {
      const float offset = (static_cast<float>(i) + 0.5f) / count - 0.5f;
      sum += trilinear(u + offset * footprint.step_u, v + offset * footprint.step_v, footprint.lod);
    }
    return sum / count;
  }

 private:
  static constexpr int kMaxTaps = 4;

  struct Level {
    int width = 0, height = 0;
    float scale_x = 1, scale_y = 1;  // texels of this level per texel of level 0
    std::vector<std::uint16_t> texels;
  };

  float bilinear(const Level& level, float u, float v) const {
    const float x = std::clamp(u * level.scale_x - 0.5f, 0.0f, level.width - 1.001f);
    const float y = std::clamp(v * level.scale_y - 0.5f, 0.0f, level.height - 1.001f);
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
    const std::uint16_t* top = level.texels.data() + row * level.width + column;
    const std::uint16_t* low = top + level.width;
    const float upper = static_cast<float>(top[0]) * (1 - fx) + static_cast<float>(top[1]) * fx;
    const float lower = static_cast<float>(low[0]) * (1 - fx) + static_cast<float>(low[1]) * fx;
    return (upper * (1 - fy) + lower * fy) * (1.0f / 256.0f);
  }

  float trilinear(float u, float v, float lod) const {
    const int fine = static_cast<int>(lod);
    const float fraction = lod - static_cast<float>(fine);
    const float value = bilinear(levels_[fine], u, v);
    if (fraction < 0.02f) return value;
    return value + fraction * (bilinear(levels_[fine + 1], u, v) - value);
  }

  double pixels_per_metre_ = 1;
  std::vector<Level> levels_;
};

}  // namespace cairn::synthetic
