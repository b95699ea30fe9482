#include "tests/support/scene_builder.h"

#include <cmath>

#include "tests/support/parallel.h"

namespace cairn::synthetic {
namespace {

// Light from above and a little from one side: surfaces of different facing differ in brightness.
float light_on(const Eigen::Vector3d& normal) {
  const Eigen::Vector3d towards_light = Eigen::Vector3d(0.35, -0.5, 0.8).normalized();
  return static_cast<float>(0.84 + 0.16 * normal.dot(towards_light));
}

}  // namespace

int SceneBuilder::texture(double width, double height, double pixels_per_metre, Paint paint) {
  surfaces_.push_back({{width, height, pixels_per_metre}, std::move(paint)});
  return static_cast<int>(surfaces_.size()) - 1;
}

void SceneBuilder::add(const Eigen::Vector3d& centre, const Eigen::Vector3d& u,
                       const Eigen::Vector3d& v, double width, double height, int texture) {
  const Eigen::Vector3d corner = centre - 0.5 * width * u - 0.5 * height * v;
  quads_.push_back({corner, u, v, width, height, texture, light_on(v.cross(u))});
}

void SceneBuilder::upright(const Eigen::Vector3d& centre, const Eigen::Vector3d& facing,
                           double width, double height, int texture) {
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d right = up.cross(facing).normalized();
  add(centre, right, -up, width, height, texture);
}

void SceneBuilder::upright(const Eigen::Vector3d& centre, const Eigen::Vector3d& facing,
                           double width, double height, double pixels_per_metre,
                           const Paint& paint) {
  upright(centre, facing, width, height, texture(width, height, pixels_per_metre, paint));
}

void SceneBuilder::level(const Eigen::Vector3d& centre, double yaw, double width, double depth,
                         double pixels_per_metre, const Paint& paint) {
  const Eigen::Vector3d u(std::cos(yaw), std::sin(yaw), 0), v(std::sin(yaw), -std::cos(yaw), 0);
  add(centre, u, v, width, depth, texture(width, depth, pixels_per_metre, paint));
}

void SceneBuilder::ceiling(const Eigen::Vector3d& centre, double width, double depth,
                           double pixels_per_metre, const Paint& paint) {
  add(centre, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY(), width, depth,
      texture(width, depth, pixels_per_metre, paint));
}

void SceneBuilder::box(const Eigen::Vector3d& base, const Eigen::Vector3d& size, double yaw,
                       double pixels_per_metre, const BoxPaint& paint) {
  const Eigen::Vector3d x(std::cos(yaw), std::sin(yaw), 0), y(-std::sin(yaw), std::cos(yaw), 0);
  const Eigen::Vector3d middle = base + 0.5 * size.z() * Eigen::Vector3d::UnitZ();
  const Paint& front = paint.front ? paint.front : paint.side;
  upright(middle - 0.5 * size.y() * y, -y, size.x(), size.z(), pixels_per_metre, front);
  upright(middle + 0.5 * size.x() * x, x, size.y(), size.z(), pixels_per_metre, paint.side);
  upright(middle + 0.5 * size.y() * y, y, size.x(), size.z(), pixels_per_metre, paint.side);
  upright(middle - 0.5 * size.x() * x, -x, size.y(), size.z(), pixels_per_metre, paint.side);
  level(base + size.z() * Eigen::Vector3d::UnitZ(), yaw, size.x(), size.y(), pixels_per_metre,
        paint.top);
}

void SceneBuilder::walls(double width, double depth, double height, bool inside,
                         double pixels_per_metre, const Paint& paint) {
  const double sign = inside ? -1.0 : 1.0;
  for (const Eigen::Vector3d& side : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0),
                                      Eigen::Vector3d(-1, 0, 0), Eigen::Vector3d(0, -1, 0)}) {
    const bool along_y = side.x() != 0;
    const Eigen::Vector3d centre(side.x() * width / 2, side.y() * depth / 2, height / 2);
    upright(centre, sign * side, along_y ? depth : width, height, pixels_per_metre, paint);
  }
}

std::shared_ptr<const Scene> SceneBuilder::build() const {
  auto scene = std::make_shared<Scene>();
  scene->name = name_;
  scene->quads = quads_;
  scene->textures.resize(surfaces_.size());
  parallel_for(static_cast<int>(surfaces_.size()), 2, 1, [&](int i) {
    Random random(derive_seed(seed_, static_cast<std::uint64_t>(i)));
    const Surface& surface = surfaces_[i];
    scene->textures[i] =
        Texture(surface.paint(random, surface.area), surface.area.pixels_per_metre);
  });
  return scene;
}

}  // namespace cairn::synthetic
