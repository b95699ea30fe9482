// The image at several scales, so that a place is recognised from nearer and from farther away.
#pragma once

#include <vector>

#include <opencv2/core/mat.hpp>

#include "client/frontend/resize.h"
#include "common/model/features.h"

namespace cairn {

// Images of falling size in one allocation, all with the same distance between rows: a table of
// pixel offsets made once serves every level. Allocates only when the sizes change.
class LevelStack {
 public:
  void reshape(const std::vector<cv::Size>& sizes);
  int levels() const { return static_cast<int>(views_.size()); }
  cv::Mat& operator[](int level) { return views_[static_cast<std::size_t>(level)]; }
  const cv::Mat& operator[](int level) const { return views_[static_cast<std::size_t>(level)]; }
  const std::vector<cv::Size>& sizes() const { return sizes_; }

 private:
  std::vector<cv::Size> sizes_;
  cv::Mat storage_;  // CV_8UC1
  std::vector<cv::Mat> views_;
};

// Pyramid of one image; level 0 is a copy of it. Used from one thread.
class Pyramid {
 public:
  explicit Pyramid(const ScalePyramid& shape, const Kernels& kernels = best_kernels())
      : shape_(shape), kernels_(&kernels) {}

  // `gray` is CV_8UC1. Each level is made from the one below it by bilinear interpolation.
  void build(const cv::Mat& gray);

  int levels() const { return images_.levels(); }
  const cv::Mat& operator[](int level) const { return images_[level]; }
  const std::vector<cv::Size>& sizes() const { return images_.sizes(); }

  // Positions of one level at full resolution, and back. Both have pixel centres at whole numbers:
  // the centre of the top left pixel of level l lies (s - 1) / 2 off that of level 0, in the
  // direction of the image's middle. Sizes are rounded, so s is not exactly factor^l.
  cv::Point2f to_full(int level, cv::Point2f p) const;
  cv::Point2f from_full(int level, cv::Point2f p) const;
  float scale_x(int level) const { return scales_[static_cast<std::size_t>(level)].x; }

 private:
  void reshape(cv::Size full);

  ScalePyramid shape_;
  const Kernels* kernels_;
  std::vector<ResizeMap> maps_;  // maps_[l]: from level l to l + 1
  LevelStack images_;
  std::vector<cv::Point2f> scales_;  // full resolution / level, along x and y
};

}  // namespace cairn
