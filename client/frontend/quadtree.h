// Choice of corners spread over the image.
//
// Source of the idea: the ORB-SLAM paper (Mur-Artal et al. 2015), which wants features
// homogeneously distributed. Here: cells with more than one corner are quartered, the fullest
// first, until there are as many cells as corners wanted; the strongest corner of each cell is
// kept.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <opencv2/core/types.hpp>

#include "client/frontend/corner.h"

namespace cairn {

// Used from one thread; keeps scratch memory between calls.
class Quadtree {
 public:
  // Replaces `chosen` by at most `wanted` of `corners`, all of which lie in `area`. The choice does
  // not depend on anything but the arguments.
  void choose(std::span<const Corner> corners, const cv::Rect& area, int wanted,
              std::vector<Corner>& chosen);

 private:
  struct Node {
    std::uint32_t begin, end;  // range in order_
    float left, top, right, bottom;
    std::uint32_t size() const { return end - begin; }
  };
  void start(std::span<const Corner> corners, const cv::Rect& area);
  bool refine(std::span<const Corner> corners, std::size_t wanted);
  void split(std::span<const Corner> corners, std::size_t node);

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;       // corner indices, those of a node together
  std::vector<std::uint32_t> splittable_;  // node indices
};

}  // namespace cairn
