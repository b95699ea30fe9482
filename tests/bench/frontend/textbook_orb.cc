#include "tests/bench/frontend/textbook_orb.h"

#include <algorithm>
#include <cmath>
#include <list>

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include "client/frontend/brief_pattern.h"

namespace cairn::bench {
namespace {

constexpr int kBorder = 19;  // as the extractor under test: the turned pattern must stay inside
constexpr int kRadius = 15;  // of the patch whose centroid gives the orientation

struct Node {
  cv::Rect2f area;
  std::vector<cv::KeyPoint> corners;
};

// The four quarters of a node that hold corners.
std::vector<Node> quarters(const Node& node) {
  const cv::Size2f half(node.area.width / 2, node.area.height / 2);
  const cv::Point2f middle(node.area.x + half.width, node.area.y + half.height);
  std::vector<Node> four(4);
  for (int i = 0; i < 4; ++i)
    four[static_cast<std::size_t>(i)].area = {
        {i % 2 == 0 ? node.area.x : middle.x, i < 2 ? node.area.y : middle.y}, half};
  for (const cv::KeyPoint& c : node.corners)
    four[(c.pt.x >= middle.x ? 1u : 0u) + (c.pt.y >= middle.y ? 2u : 0u)].corners.push_back(c);
  std::erase_if(four, [](const Node& n) { return n.corners.empty(); });
  return four;
}

// Nodes with several corners are quartered until there are as many nodes as corners wanted; of each
// node the best corner stays.
std::vector<cv::KeyPoint> distribute(std::vector<cv::KeyPoint> corners, const cv::Rect& area,
                                     std::size_t wanted) {
  std::list<Node> nodes = {{cv::Rect2f(area), std::move(corners)}};
  bool split = true;
  while (split && nodes.size() < wanted) {
    split = false;
    for (auto it = nodes.begin(); it != nodes.end() && nodes.size() < wanted;) {
      if (it->corners.size() < 2 || it->area.width < 1) {
        ++it;
        continue;
      }
      for (Node& quarter : quarters(*it)) nodes.push_front(std::move(quarter));
      it = nodes.erase(it);
      split = true;
    }
  }
  std::vector<cv::KeyPoint> best;
  for (const Node& n : nodes)
    if (!n.corners.empty())
      best.push_back(*std::max_element(
          n.corners.begin(), n.corners.end(),
          [](const cv::KeyPoint& a, const cv::KeyPoint& b) { return a.response < b.response; }));
  if (best.size() > wanted) best.resize(wanted);
  return best;
}

// atan2 of the first moments over a disc; rows above and below the centre together.
float centroid_angle(const cv::Mat& image, int x, int y) {
  static const std::vector<int> widths = [] {
    std::vector<int> w;
    for (int v = 0; v <= kRadius; ++v)
      w.push_back(static_cast<int>(std::lround(std::sqrt(kRadius * kRadius - v * v))));
    return w;
  }();
  const auto stride = static_cast<std::ptrdiff_t>(image.step);
  const std::uint8_t* centre = image.ptr<std::uint8_t>(y) + x;
  int m10 = 0, m01 = 0;
  for (int u = -kRadius; u <= kRadius; ++u) m10 += u * centre[u];
  for (int v = 1; v <= kRadius; ++v) {
    int difference = 0;
    const int width = widths[static_cast<std::size_t>(v)];
    for (int u = -width; u <= width; ++u) {
      const int below = centre[u + v * stride], above = centre[u - v * stride];
      difference += below - above;
      m10 += u * (below + above);
    }
    m01 += v * difference;
  }
  return cv::fastAtan2(static_cast<float>(m01), static_cast<float>(m10));
}

// The tests of the pattern, each point turned and rounded.
Descriptor steered_brief(const cv::Mat& smoothed, int x, int y, float degrees) {
  const float angle = degrees * static_cast<float>(CV_PI / 180);
  const float c = std::cos(angle), s = std::sin(angle);
  const auto stride = static_cast<std::ptrdiff_t>(smoothed.step);
  const std::uint8_t* centre = smoothed.ptr<std::uint8_t>(y) + x;
  const auto pixel = [&](float px, float py) {
    return centre[cvRound(px * s + py * c) * stride + cvRound(px * c - py * s)];
  };
  Descriptor d{};
  for (std::size_t i = 0; i < kBriefTests; ++i) {
    const BriefTest& t = kBriefPattern[i];
    const bool darker = pixel(t.ax, t.ay) < pixel(t.bx, t.by);
    d[i / 64] |= static_cast<std::uint64_t>(darker) << (i % 64);
  }
  return d;
}

}  // namespace

// FAST in cells that overlap by the circle's radius; where the high threshold finds nothing, the
// low one is taken.
std::vector<cv::KeyPoint> TextbookOrb::cell_corners(const cv::Mat& level) const {
  std::vector<cv::KeyPoint> corners, found;
  const cv::Rect area(kBorder, kBorder, level.cols - 2 * kBorder, level.rows - 2 * kBorder);
  if (area.width <= 0 || area.height <= 0) return corners;
  const int columns = std::max(1, area.width / options_.cell);
  const int rows = std::max(1, area.height / options_.cell);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c) {
      const cv::Point from(area.x + c * area.width / columns, area.y + r * area.height / rows);
      const cv::Point to(area.x + (c + 1) * area.width / columns,
                         area.y + (r + 1) * area.height / rows);
      const cv::Rect cell(from - cv::Point(3, 3), to + cv::Point(3, 3));
      cv::FAST(level(cell), found, options_.high_threshold, true);
      if (found.empty()) cv::FAST(level(cell), found, options_.low_threshold, true);
      for (cv::KeyPoint& k : found) {
        k.pt += cv::Point2f(cell.tl());
        corners.push_back(k);
      }
    }
  return corners;
}

void TextbookOrb::extract(const cv::Mat& gray, Features& out) {
  out.points.clear();
  out.descriptors.clear();
  pyramid_.resize(static_cast<std::size_t>(options_.levels));
  const double q = 1 / options_.factor;
  double wanted = options_.features * (1 - q) / (1 - std::pow(q, options_.levels));
  double scale = 1;
  for (std::size_t level = 0; level < pyramid_.size(); ++level) {
    cv::Mat& image = pyramid_[level];
    if (level == 0)
      gray.copyTo(image);
    else
      cv::resize(pyramid_[level - 1], image,
                 {cvRound(gray.cols / scale), cvRound(gray.rows / scale)}, 0, 0, cv::INTER_LINEAR);
    const cv::Rect area(kBorder, kBorder, image.cols - 2 * kBorder, image.rows - 2 * kBorder);
    const auto chosen =
        distribute(cell_corners(image), area, static_cast<std::size_t>(std::lround(wanted)));
    cv::Mat smoothed;
    cv::GaussianBlur(image, smoothed, {7, 7}, 2, 2, cv::BORDER_REFLECT_101);
    for (const cv::KeyPoint& k : chosen) {
      const int x = cvRound(k.pt.x), y = cvRound(k.pt.y);
      const float angle = centroid_angle(image, x, y);
      out.points.push_back({.x = static_cast<float>(x * scale),
                            .y = static_cast<float>(y * scale),
                            .angle = angle * static_cast<float>(CV_PI / 180),
                            .octave = static_cast<std::uint8_t>(level)});
      out.descriptors.push_back(steered_brief(smoothed, x, y, angle));
    }
    wanted *= q;
    scale *= options_.factor;
  }
}

}  // namespace cairn::bench
