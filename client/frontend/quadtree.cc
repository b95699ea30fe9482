#include "client/frontend/quadtree.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace cairn {
namespace {

constexpr float kSmallestNode = 0.25f;  // pixels: below, corners share a pixel and can't be parted

// A total order, so that the choice does not depend on the order of the corners.
bool stronger(const Corner& a, const Corner& b) {
  return std::tuple(-a.score, a.y, a.x) < std::tuple(-b.score, b.y, b.x);
}

}  // namespace

// One square-ish node after the other along the longer side of the area.
void Quadtree::start(std::span<const Corner> corners, const cv::Rect& area) {
  order_.resize(corners.size());
  std::iota(order_.begin(), order_.end(), 0u);
  nodes_.clear();
  const auto left = static_cast<float>(area.x), top = static_cast<float>(area.y);
  const auto width = static_cast<float>(area.width), height = static_cast<float>(area.height);
  const int columns = std::max(1, static_cast<int>(std::lround(width / height)));
  auto begin = order_.begin();
  for (int i = 0; i < columns; ++i) {
    const float x0 = left + width * static_cast<float>(i) / static_cast<float>(columns);
    const float x1 = left + width * static_cast<float>(i + 1) / static_cast<float>(columns);
    const auto end =
        i + 1 == columns ? order_.end() : std::partition(begin, order_.end(), [&](std::uint32_t c) {
          return static_cast<float>(corners[c].x) < x1;
        });
    if (begin != end)
      nodes_.push_back({static_cast<std::uint32_t>(begin - order_.begin()),
                        static_cast<std::uint32_t>(end - order_.begin()), x0, top, x1,
                        top + height});
    begin = end;
  }
}

// Replaces the node by its non-empty quarters: the first in its place, the others at the end.
void Quadtree::split(std::span<const Corner> corners, std::size_t node) {
  const Node n = nodes_[node];
  const float x = (n.left + n.right) / 2, y = (n.top + n.bottom) / 2;
  const auto is_left = [&](std::uint32_t c) { return static_cast<float>(corners[c].x) < x; };
  const auto is_top = [&](std::uint32_t c) { return static_cast<float>(corners[c].y) < y; };
  const auto begin = order_.begin() + n.begin, end = order_.begin() + n.end;
  const auto middle = std::partition(begin, end, is_top);
  const auto upper = std::partition(begin, middle, is_left);
  const auto lower = std::partition(middle, end, is_left);
  const auto at = [&](auto i) { return static_cast<std::uint32_t>(i - order_.begin()); };
  const Node quarters[4] = {{at(begin), at(upper), n.left, n.top, x, y},
                            {at(upper), at(middle), x, n.top, n.right, y},
                            {at(middle), at(lower), n.left, y, x, n.bottom},
                            {at(lower), at(end), x, y, n.right, n.bottom}};
  bool placed = false;
  for (const Node& q : quarters) {
    if (q.size() == 0) continue;
    if (placed)
      nodes_.push_back(q);
    else
      nodes_[node] = q;
    placed = true;
  }
}

// One round over the nodes that hold several corners. False when there is none.
bool Quadtree::refine(std::span<const Corner> corners, std::size_t wanted) {
  splittable_.clear();
  for (std::uint32_t i = 0; i < nodes_.size(); ++i)
    if (nodes_[i].size() > 1 && nodes_[i].right - nodes_[i].left > kSmallestNode)
      splittable_.push_back(i);
  if (splittable_.empty()) return false;
  std::sort(splittable_.begin(), splittable_.end(), [&](std::uint32_t a, std::uint32_t b) {
    return nodes_[a].size() != nodes_[b].size() ? nodes_[a].size() > nodes_[b].size() : a < b;
  });
  for (const std::uint32_t i : splittable_) {
    if (nodes_.size() >= wanted) break;
    split(corners, i);
  }
  return true;
}

void Quadtree::choose(std::span<const Corner> corners, const cv::Rect& area, int wanted,
                      std::vector<Corner>& chosen) {
  chosen.clear();
  if (corners.empty() || wanted <= 0) return;
  const auto limit = static_cast<std::size_t>(wanted);
  start(corners, area);
  while (nodes_.size() < limit && refine(corners, limit)) {
  }
  for (const Node& n : nodes_) {
    const auto best = std::min_element(
        order_.begin() + n.begin, order_.begin() + n.end,
        [&](std::uint32_t a, std::uint32_t b) { return stronger(corners[a], corners[b]); });
    chosen.push_back(corners[*best]);
  }
  if (chosen.size() > limit) {  // the last split may give up to three too many
    std::nth_element(chosen.begin(), chosen.begin() + wanted, chosen.end(), stronger);
    chosen.resize(limit);
  }
}

}  // namespace cairn
