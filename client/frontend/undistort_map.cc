#include "client/frontend/undistort_map.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cairn {
namespace {

constexpr int kSpacing = 4;  // pixels
constexpr float kMaxCurvature =
    0.04f;  // pixels of second difference, about 8 * 0.01 px for two axes
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

}  // namespace

UndistortMap::UndistortMap(const Camera& camera)
    : camera_(camera), distorts_(camera.has_distortion()) {
  if (!distorts_) return;
  columns_ = camera.width() / kSpacing + 2;  // the last pixel too has a node on its right
  rows_ = camera.height() / kSpacing + 2;
  nodes_.reserve(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < columns_; ++c) {
      const auto ideal = camera.undistort({c * kSpacing, r * kSpacing});
      nodes_.push_back(ideal ? Eigen::Vector2f(ideal->cast<float>())
                             : Eigen::Vector2f(kNone, kNone));
    }
  drop_curved();
}

Eigen::Vector2f& UndistortMap::node(int column, int row) {
  return nodes_[static_cast<std::size_t>(row * columns_ + column)];
}

// A chord leaves its curve by an eighth of the second difference, along each axis.
void UndistortMap::drop_curved() {
  std::vector<std::size_t> curved;
  const auto bends = [](const Eigen::Vector2f& a, const Eigen::Vector2f& b,
                        const Eigen::Vector2f& c) {
    return !((a - 2 * b + c).norm() <= kMaxCurvature);
  };
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < columns_; ++c) {
      // At the rim of the table the nearest inner node stands for its neighbour.
      const int x = std::clamp(c, 1, columns_ - 2), y = std::clamp(r, 1, rows_ - 2);
      if (bends(node(x - 1, y), node(x, y), node(x + 1, y)) ||
          bends(node(x, y - 1), node(x, y), node(x, y + 1)))
        curved.push_back(static_cast<std::size_t>(r * columns_ + c));
    }
  for (const std::size_t i : curved) nodes_[i] = {kNone, kNone};
}

std::optional<Eigen::Vector2f> UndistortMap::undistort(float x, float y) const {
  if (!(x >= -0.5f && y >= -0.5f && x <= static_cast<float>(camera_.width()) - 0.5f &&
        y <= static_cast<float>(camera_.height()) - 0.5f))
    return std::nullopt;
  if (!distorts_) return Eigen::Vector2f(x, y);
  if (x >= 0 && y >= 0) {
    const float u = x / kSpacing, v = y / kSpacing;
    const int c = static_cast<int>(u), r = static_cast<int>(v);
    const float a = u - static_cast<float>(c), b = v - static_cast<float>(r);
    const Eigen::Vector2f* top = &nodes_[static_cast<std::size_t>(r * columns_ + c)];
    const Eigen::Vector2f* bottom = top + columns_;
    const Eigen::Vector2f p =
        (1 - b) * ((1 - a) * top[0] + a * top[1]) + b * ((1 - a) * bottom[0] + a * bottom[1]);
    if (p.allFinite()) return p;
  }
  const auto exact = camera_.undistort({x, y});
  if (!exact) return std::nullopt;
  return Eigen::Vector2f(exact->cast<float>());
}

}  // namespace cairn
