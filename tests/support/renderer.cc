#include "tests/support/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tests/support/parallel.h"

namespace cairn::synthetic {
namespace {

constexpr double kNear = 0.05;  // metres
constexpr int kSegment = 8;     // pixels that share a texture footprint

// A function of the ray: x * dx + y * dy + c.
struct Linear {
  float x = 0, y = 0, c = 0;

  Linear() = default;
  explicit Linear(const Eigen::Vector3d& v)
      : x(static_cast<float>(v.x())), y(static_cast<float>(v.y())), c(static_cast<float>(v.z())) {}
  float at(float dx, float dy) const { return x * dx + y * dy + c; }
};

// 16 points in the unit square, one in each sixteenth of its width and of its height.
constexpr std::array<std::array<float, 2>, 16> kSubSamples = [] {
  std::array<std::array<float, 2>, 16> points{};
  for (int i = 0; i < 16; ++i) {
    const int reversed = (i & 1) << 3 | (i & 2) << 1 | (i & 4) >> 1 | (i & 8) >> 3;
    points[i] = {(static_cast<float>(i) + 0.5f) / 16 - 0.5f,
                 (static_cast<float>(reversed) + 0.5f) / 16 - 0.5f};
  }
  return points;
}();

}  // namespace

// A quad in front of the camera. All but the bounds are linear in the ray; s and t are metres along
// the quad's u and v.
struct Renderer::Plane {
  Linear inverse_depth, s_over_depth, t_over_depth;
  float width, height;                   // metres
  float dx_min, dx_max, dy_min, dy_max;  // bounds of the visible part
  float texels_per_metre, gain;
  const Texture* texture;

  bool covers(float inverse, float dx, float dy) const {
    const float s = s_over_depth.at(dx, dy), t = t_over_depth.at(dx, dy);
    return s >= 0 && s <= width * inverse && t >= 0 && t <= height * inverse;
  }
};

Renderer::Renderer(std::shared_ptr<const Scene> scene, const Camera& camera, int threads)
    : scene_(std::move(scene)), threads_(std::max(1, threads)) {
  const int width = camera.width(), height = camera.height();
  // One column and row more than the image, for the step from the last pixel on.
  dx_.create(height + 1, width + 1, CV_32F);
  dy_.create(height + 1, width + 1, CV_32F);
  // Not a structured binding: clang does not let a lambda have one.
  const std::array<double, 4>& intrinsics = camera.intrinsics();
  const double fx = intrinsics[0], fy = intrinsics[1], cx = intrinsics[2], cy = intrinsics[3];
  parallel_for(height + 1, threads_, 16, [&](int y) {
    for (int x = 0; x <= width; ++x) {
      double dx = (x - cx) / fx, dy = (y - cy) / fy;
      if (camera.has_distortion() || camera.lens() == LensModel::kFisheye) {
        const auto ray = camera.unproject({static_cast<double>(x), static_cast<double>(y)});
        // Directions that the lens can't see, or at 90 degrees, look far past everything.
        const bool ahead = ray && ray->z() > 0.02;
        dx = ahead ? ray->x() / ray->z() : std::copysign(1e4, dx);
        dy = ahead ? ray->y() / ray->z() : std::copysign(1e4, dy);
      }
      dx_.at<float>(y, x) = static_cast<float>(dx);
      dy_.at<float>(y, x) = static_cast<float>(dy);
    }
  });
  dx_min_ = std::numeric_limits<float>::max();
  dx_max_ = -dx_min_;
  for (int y = 0; y < height; ++y) {
    const float* ys = dy_.ptr<float>(y);
    row_dy_min_.push_back(*std::min_element(ys, ys + width));
    row_dy_max_.push_back(*std::max_element(ys, ys + width));
    const float* xs = dx_.ptr<float>(y);
    dx_min_ = std::min(dx_min_, *std::min_element(xs, xs + width));
    dx_max_ = std::max(dx_max_, *std::max_element(xs, xs + width));
  }
}

std::vector<Renderer::Plane> Renderer::visible_planes(const Rigid3& world_from_camera) const {
  const Rigid3 camera_from_world = world_from_camera.inverse();
  const float dy_low = *std::min_element(row_dy_min_.begin(), row_dy_min_.end());
  const float dy_high = *std::max_element(row_dy_max_.begin(), row_dy_max_.end());
  std::vector<Plane> planes;
  for (const Quad& quad : scene_->quads) {
    const Eigen::Vector3d o = camera_from_world * quad.corner;
    const Eigen::Vector3d u = camera_from_world.rotation * quad.u;
    const Eigen::Vector3d v = camera_from_world.rotation * quad.v;
    const Eigen::Vector3d away = u.cross(v);  // from the viewer, for the side that can be seen
    const double distance = away.dot(o);
    if (distance <= 1e-6) continue;
    // Corners in order, clipped against the near plane (Sutherland and Hodgman 1974).
    const std::array<Eigen::Vector3d, 4> corners = {
        o, o + quad.width * u, o + quad.width * u + quad.height * v, o + quad.height * v};
    Plane plane;
    plane.dx_min = plane.dy_min = std::numeric_limits<float>::max();
    plane.dx_max = plane.dy_max = -std::numeric_limits<float>::max();
    const auto include = [&](const Eigen::Vector3d& p) {
      const auto dx = static_cast<float>(p.x() / p.z()), dy = static_cast<float>(p.y() / p.z());
      plane.dx_min = std::min(plane.dx_min, dx);
      plane.dx_max = std::max(plane.dx_max, dx);
      plane.dy_min = std::min(plane.dy_min, dy);
      plane.dy_max = std::max(plane.dy_max, dy);
    };
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d &a = corners[i], &b = corners[(i + 1) % 4];
      if (a.z() >= kNear) include(a);
      if ((a.z() >= kNear) != (b.z() >= kNear)) {
        include(a + (kNear - a.z()) / (b.z() - a.z()) * (b - a));
      }
    }
    if (plane.dx_min > dx_max_ || plane.dx_max < dx_min_ || plane.dy_min > dy_high ||
        plane.dy_max < dy_low) {
      continue;
    }
    // A point X = depth * ray on the plane: away . X = distance, and s = u . (X - o).
    const Eigen::Vector3d inverse = away / distance;
    plane.inverse_depth = Linear(inverse);
    plane.s_over_depth = Linear(u - u.dot(o) * inverse);
    plane.t_over_depth = Linear(v - v.dot(o) * inverse);
    plane.width = static_cast<float>(quad.width);
    plane.height = static_cast<float>(quad.height);
    plane.texture = &scene_->textures[quad.texture];
    plane.texels_per_metre = static_cast<float>(plane.texture->pixels_per_metre());
    plane.gain = quad.gain;
    planes.push_back(plane);
  }
  return planes;
}

void Renderer::find_nearest(const std::vector<Plane>& planes, int row, float* inverse_depth,
                            std::int32_t* nearest) const {
  const int width = dx_.cols - 1;
  const float* dx = dx_.ptr<float>(row);
  const float* dy = dy_.ptr<float>(row);
  std::fill(inverse_depth, inverse_depth + width, 0.0f);
  std::fill(nearest, nearest + width, -1);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const Plane& p = planes[i];
    if (p.dy_min > row_dy_max_[row] || p.dy_max < row_dy_min_[row]) continue;
    // Rays run from left to right along a row; two pixels of slack for rounding.
    const int first =
        std::max<int>(0, static_cast<int>(std::lower_bound(dx, dx + width, p.dx_min) - dx) - 2);
    const int last =
        std::min<int>(width, static_cast<int>(std::upper_bound(dx, dx + width, p.dx_max) - dx) + 2);
    const auto id = static_cast<std::int32_t>(i);
    const Linear inverse = p.inverse_depth, s_line = p.s_over_depth, t_line = p.t_over_depth;
    const float quad_width = p.width, quad_height = p.height;
    for (int x = first; x < last; ++x) {
      const float z = inverse.at(dx[x], dy[x]);
      const float s = s_line.at(dx[x], dy[x]), t = t_line.at(dx[x], dy[x]);
      const bool hit = (z > inverse_depth[x]) & (s >= 0) & (s <= quad_width * z) & (t >= 0) &
                       (t <= quad_height * z);
      inverse_depth[x] = hit ? z : inverse_depth[x];
      nearest[x] = hit ? id : nearest[x];
    }
  }
}

void Renderer::shade_run(const Plane& p, int row, int first, int last, float* radiance) const {
  const float* dx = dx_.ptr<float>(row);
  const float* dy = dy_.ptr<float>(row);
  const float* dy_below = dy_.ptr<float>(row + 1);
  const float scale = p.texels_per_metre;
  for (int begin = first; begin < last; begin += kSegment) {
    const int end = std::min(begin + kSegment, last), middle = (begin + end) / 2;
    const float step_x = dx[middle + 1] - dx[middle], step_y = dy_below[middle] - dy[middle];
    const float z = 1.0f / p.inverse_depth.at(dx[middle], dy[middle]);
    const float s = p.s_over_depth.at(dx[middle], dy[middle]) * z;
    const float t = p.t_over_depth.at(dx[middle], dy[middle]) * z;
    // Derivatives of s = (s / z) * z by the ray, times the ray's step to the next pixel.
    const float k = z * scale;
    const Texture::Footprint footprint =
        p.texture->footprint(k * step_x * (p.s_over_depth.x - s * p.inverse_depth.x),
                             k * step_y * (p.s_over_depth.y - s * p.inverse_depth.y),
                             k * step_x * (p.t_over_depth.x - t * p.inverse_depth.x),
                             k * step_y * (p.t_over_depth.y - t * p.inverse_depth.y));
    for (int x = begin; x < end; ++x) {
      const float texels = scale / p.inverse_depth.at(dx[x], dy[x]);
      radiance[x] = p.gain * p.texture->sample(p.s_over_depth.at(dx[x], dy[x]) * texels,
                                               p.t_over_depth.at(dx[x], dy[x]) * texels, footprint);
    }
  }
}

float Renderer::shade(const Plane& p, float dx, float dy, float step_x, float step_y) const {
  const float z = 1.0f / p.inverse_depth.at(dx, dy);
  const float s = p.s_over_depth.at(dx, dy) * z, t = p.t_over_depth.at(dx, dy) * z;
  const float k = z * p.texels_per_metre;
  const Texture::Footprint footprint =
      p.texture->footprint(k * step_x * (p.s_over_depth.x - s * p.inverse_depth.x),
                           k * step_y * (p.s_over_depth.y - s * p.inverse_depth.y),
                           k * step_x * (p.t_over_depth.x - t * p.inverse_depth.x),
                           k * step_y * (p.t_over_depth.y - t * p.inverse_depth.y));
  return p.gain * p.texture->sample(s * p.texels_per_metre, t * p.texels_per_metre, footprint);
}

float Renderer::shade_border(const std::vector<Plane>& planes, int row, int column,
                             const cv::Mat& nearest) const {
  // The surfaces seen in the 3x3 pixels around; others hardly reach into this one.
  std::array<std::int32_t, 9> candidates{};
  int count = 0;
  for (int y = std::max(0, row - 1); y <= std::min(nearest.rows - 1, row + 1); ++y) {
    for (int x = std::max(0, column - 1); x <= std::min(nearest.cols - 1, column + 1); ++x) {
      const std::int32_t id = nearest.at<std::int32_t>(y, x);
      const auto end = candidates.begin() + count;
      if (id >= 0 && std::find(candidates.begin(), end, id) == end) candidates[count++] = id;
    }
  }
  const float dx = dx_.at<float>(row, column), dy = dy_.at<float>(row, column);
  const float step_x = dx_.at<float>(row, column + 1) - dx;
  const float step_y = dy_.at<float>(row + 1, column) - dy;
  struct Share {
    int samples = 0;
    float x = 0, y = 0;
  };
  std::array<Share, 9> shares{};
  for (const auto& [fraction_x, fraction_y] : kSubSamples) {
    const float sub_x = dx + fraction_x * step_x, sub_y = dy + fraction_y * step_y;
    float best = 0;
    int winner = -1;
    for (int i = 0; i < count; ++i) {
      const Plane& plane = planes[candidates[i]];
      const float inverse = plane.inverse_depth.at(sub_x, sub_y);
      if (inverse > best && plane.covers(inverse, sub_x, sub_y)) {
        best = inverse;
        winner = i;
      }
    }
    if (winner < 0) continue;
    ++shares[winner].samples;
    shares[winner].x += sub_x;
    shares[winner].y += sub_y;
  }
  // Each surface is looked up once, in the middle of its part of the pixel.
  float sum = 0;
  int samples = 0;
  for (int i = 0; i < count; ++i) {
    const Share& share = shares[i];
    if (share.samples == 0) continue;
    const float weight = static_cast<float>(share.samples);
    sum +=
        weight * shade(planes[candidates[i]], share.x / weight, share.y / weight, step_x, step_y);
    samples += share.samples;
  }
  return samples > 0 ? sum / static_cast<float>(samples) : 0.0f;
}

void Renderer::shade_row(const std::vector<Plane>& planes, int row, const cv::Mat& nearest,
                         float* radiance) const {
  const int width = nearest.cols;
  const auto* ids = nearest.ptr<std::int32_t>(row);
  const auto* above = nearest.ptr<std::int32_t>(std::max(0, row - 1));
  const auto* below = nearest.ptr<std::int32_t>(std::min(nearest.rows - 1, row + 1));
  const auto is_border = [&](int x) {
    const std::int32_t id = ids[x];
    // Without branches: any bit that differs from one of the neighbours.
    return ((above[x] ^ id) | (below[x] ^ id) | (ids[std::max(0, x - 1)] ^ id) |
            (ids[std::min(width - 1, x + 1)] ^ id)) != 0;
  };
  for (int x = 0; x < width;) {
    if (is_border(x)) {
      radiance[x] = shade_border(planes, row, x, nearest);
      ++x;
      continue;
    }
    int end = x + 1;
    while (end < width && !is_border(end)) ++end;
    if (ids[x] >= 0) {
      shade_run(planes[ids[x]], row, x, end, radiance);
    } else {
      std::fill(radiance + x, radiance + end, 0.0f);
    }
    x = end;
  }
}

Rendering Renderer::render(const Rigid3& world_from_camera) const {
  const int width = dx_.cols - 1, height = dx_.rows - 1;
  const std::vector<Plane> planes = visible_planes(world_from_camera);
  Rendering result{cv::Mat(height, width, CV_32F), cv::Mat(height, width, CV_32F)};
  cv::Mat nearest(height, width, CV_32S);
  parallel_for(height, threads_, 8, [&](int row) {
    find_nearest(planes, row, result.depth.ptr<float>(row), nearest.ptr<std::int32_t>(row));
  });
  parallel_for(height, threads_, 8, [&](int row) {
    shade_row(planes, row, nearest, result.radiance.ptr<float>(row));
    float* depth = result.depth.ptr<float>(row);
    for (int x = 0; x < width; ++x) depth[x] = depth[x] > 0 ? 1.0f / depth[x] : 0.0f;
  });
  return result;
}

}  // namespace cairn::synthetic
