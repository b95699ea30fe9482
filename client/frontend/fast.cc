#include "client/frontend/fast.h"

#include <algorithm>

#include <opencv2/features2d.hpp>

namespace cairn {
namespace {

constexpr int kCircleRadius = 3;

}  // namespace

// The circle of corners in `area` reaches kCircleRadius pixels beyond it.
void FastDetector::append(const cv::Mat& level, const cv::Rect& area, int threshold,
                          std::vector<Corner>& corners) {
  const cv::Rect reached(area.x - kCircleRadius, area.y - kCircleRadius,
                         area.width + 2 * kCircleRadius, area.height + 2 * kCircleRadius);
  cv::FAST(level(reached), found_, threshold, true, cv::FastFeatureDetector::TYPE_9_16);
  for (const cv::KeyPoint& k : found_)
    corners.push_back({static_cast<std::int16_t>(static_cast<int>(k.pt.x) + reached.x),
                       static_cast<std::int16_t>(static_cast<int>(k.pt.y) + reached.y),
                       static_cast<std::int16_t>(k.response)});
}

void FastDetector::detect(const cv::Mat& level, int border, std::vector<Corner>& corners) {
  corners.clear();
  const cv::Rect area(border, border, level.cols - 2 * border, level.rows - 2 * border);
  if (area.width <= 0 || area.height <= 0) return;
  append(level, area, options_.high_threshold, corners);
  if (options_.low_threshold <= 0) return;

  const int columns = std::max(1, (area.width + options_.cell / 2) / options_.cell);
  const int rows = std::max(1, (area.height + options_.cell / 2) / options_.cell);
  occupied_.assign(static_cast<std::size_t>(columns * rows), 0);
  for (const Corner& c : corners) {
    const int column = (c.x - area.x) * columns / area.width;
    const int row = (c.y - area.y) * rows / area.height;
    occupied_[static_cast<std::size_t>(row * columns + column)] = 1;
  }
  // Cell i covers the pixels x with x * columns / width == i, as above.
  const auto edge = [](int i, int length, int cells) { return (i * length + cells - 1) / cells; };
  for (int i = 0; i < columns * rows; ++i) {
    if (occupied_[static_cast<std::size_t>(i)]) continue;
    const int left = edge(i % columns, area.width, columns);
    const int right = edge(i % columns + 1, area.width, columns);
    const int top = edge(i / columns, area.height, rows);
    const int bottom = edge(i / columns + 1, area.height, rows);
    append(level, {area.x + left, area.y + top, right - left, bottom - top}, options_.low_threshold,
           corners);
  }
}

}  // namespace cairn
