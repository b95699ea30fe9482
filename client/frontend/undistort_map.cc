#include "client/frontend/undistort_map.h"

#include <cmath>
#include <limits>

namespace cairn {
namespace {

constexpr int kSpacing = 4;  // pixels

}  // namespace

UndistortMap::UndistortMap(const Camera& camera)
    : camera_(camera), distorts_(camera.has_distortion()) {
  if (!distorts_) return;
  columns_ = camera.width() / kSpacing + 2;  // the last pixel too has a node on its right
  rows_ = camera.height() / kSpacing + 2;
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  nodes_.reserve(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  for (int r = 0; r < rows_; ++r)
    for (int c = 0; c < columns_; ++c) {
      const auto ideal = camera.undistort({c * kSpacing, r * kSpacing});
      nodes_.push_back(ideal ? Eigen::Vector2f(ideal->cast<float>())
                             : Eigen::Vector2f(kNone, kNone));
    }
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
