#include "client/frontend/pyramid.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr int kRowAlignment = 64;  // bytes, a cache line

}  // namespace

void LevelStack::reshape(const std::vector<cv::Size>& sizes) {
  if (sizes == sizes_) return;
  sizes_ = sizes;
  int width = 0, height = 0;
  for (const cv::Size& s : sizes) {
    width = std::max(width, s.width);
    height += s.height;
  }
  const int stride = (width + kRowAlignment - 1) / kRowAlignment * kRowAlignment;
  storage_.create(height, stride, CV_8UC1);
  storage_.setTo(0);
  views_.clear();
  int top = 0;
  for (const cv::Size& s : sizes) {
    views_.push_back(storage_(cv::Rect(0, top, s.width, s.height)));
    top += s.height;
  }
}

void Pyramid::reshape(cv::Size full) {
  if (levels() > 0 && sizes().front() == full) return;
  std::vector<cv::Size> sizes;
  scales_.clear();
  for (int level = 0; level < shape_.levels; ++level) {
    const double scale = shape_.scale(level);
    sizes.emplace_back(std::max(1, static_cast<int>(std::lround(full.width / scale))),
                       std::max(1, static_cast<int>(std::lround(full.height / scale))));
    scales_.emplace_back(static_cast<float>(full.width) / static_cast<float>(sizes.back().width),
                         static_cast<float>(full.height) / static_cast<float>(sizes.back().height));
  }
  images_.reshape(sizes);
  maps_.clear();
  for (std::size_t level = 1; level < sizes.size(); ++level)
    maps_.emplace_back(sizes[level - 1], sizes[level]);
}

void Pyramid::build(const cv::Mat& gray) {
  reshape(gray.size());
  gray.copyTo(images_[0]);
  for (int level = 1; level < levels(); ++level)
    maps_[static_cast<std::size_t>(level - 1)].apply(images_[level - 1], images_[level], *kernels_);
}

cv::Point2f Pyramid::to_full(int level, cv::Point2f p) const {
  const cv::Point2f s = scales_[static_cast<std::size_t>(level)];
  return {(p.x + 0.5f) * s.x - 0.5f, (p.y + 0.5f) * s.y - 0.5f};
}

cv::Point2f Pyramid::from_full(int level, cv::Point2f p) const {
  const cv::Point2f s = scales_[static_cast<std::size_t>(level)];
  return {(p.x + 0.5f) / s.x - 0.5f, (p.y + 0.5f) / s.y - 0.5f};
}

}  // namespace cairn
