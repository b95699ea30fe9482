// Renders a scene as a camera sees it: grey levels and depth, exact to the pixel.
//
// Each plane's inverse depth and texture coordinates over depth are linear in the direction of the
// ray (dx, dy, 1), so that a pixel costs one division and no ray is traced. First pass: the nearest
// surface of each pixel (z-buffer). Second pass: texture through mip maps; pixels on the border
// between surfaces are averaged over 16 sub-samples, as a sensor's pixels average over their area.
#pragma once

#include <memory>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"
#include "tests/support/scene.h"

namespace cairn::synthetic {

// What a perfect sensor would measure. Depth is the z coordinate in the camera, metres, 0 where
// there is nothing; it holds at the centre of each pixel.
struct Rendering {
  cv::Mat radiance;  // CV_32FC1, grey levels 0..255, not rounded
  cv::Mat depth;     // CV_32FC1
};

// Immutable; render() may be called from several threads at once. The result does not depend on the
// number of threads.
class Renderer {
 public:
  // Cameras with distortion are rendered through it. `threads` work on each image.
  Renderer(std::shared_ptr<const Scene> scene, const Camera& camera, int threads);

  Rendering render(const Rigid3& world_from_camera) const;

 private:
  struct Plane;

  std::vector<Plane> visible_planes(const Rigid3& world_from_camera) const;
  void find_nearest(const std::vector<Plane>& planes, int row, float* inverse_depth,
                    std::int32_t* nearest) const;
  void shade_row(const std::vector<Plane>& planes, int row, const cv::Mat& nearest,
                 float* radiance) const;
  void shade_run(const Plane& plane, int row, int first, int last, float* radiance) const;
  float shade_border(const std::vector<Plane>& planes, int row, int column,
                     const cv::Mat& nearest) const;
  float shade(const Plane& plane, float dx, float dy, float step_x, float step_y) const;

  std::shared_ptr<const Scene> scene_;
  int threads_;
  // Direction (dx, dy, 1) of the ray through each pixel, and its change to the next pixel.
  cv::Mat dx_, dy_;
  std::vector<float> row_dy_min_, row_dy_max_;
  float dx_min_ = 0, dx_max_ = 0;
};

}  // namespace cairn::synthetic
