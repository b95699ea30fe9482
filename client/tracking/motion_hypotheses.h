// How a camera may have moved between two images, from matched pixels alone.
#pragma once

#include <span>
#include <vector>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"

namespace cairn {

struct PixelPair {
  Eigen::Vector2d a, b;  // in the ideal camera
};

// Fits an essential matrix, which any scene with depth determines, and a homography, which a plane
// does, each by consensus (OpenCV's USAC), and takes both apart (Nister 2004; Malis and Vargas
// 2007): up to eight motions `b_from_a` whose translation has unit length. Which of them it was is
// for the points to say that follow from each. A camera that only turned gives motions too, none
// with parallax. Fewer than eight pairs give none. Deterministic.
std::vector<Rigid3> motion_hypotheses(const PinholeCamera& camera,
                                      std::span<const PixelPair> pairs);

// The motions that move the points of a plane, n * p = 1, as `b_from_a` does in the images: that
// one and its dual, where the way and the plane's normal have changed places, each with both signs.
std::vector<Rigid3> planar_motions(const Rigid3& b_from_a, const Eigen::Vector3d& plane);

}  // namespace cairn
