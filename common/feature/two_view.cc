#include "server/mapping/two_view.h"

#include <array>
#include <cmath>

#include <Eigen/Dense>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

constexpr int kRounds = 3;  // the depths that weigh the rows converge at once

struct Normal {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();

  void add(const Eigen::Vector3d& row, double value) {
    information += row * row.transpose();
    right += row * value;
  }
};

// Rows in pixels over their standard deviation. With the camera's rotation R and translation t, the
// point X has depth z = R3 X + t3, and u = (pixel - c) / f gives (R1 - u R3) X = u t3 - t1.
void add_rows(const Ray& ray, double depth, Normal& normal) {
  const PinholeCamera& camera = ray.node->rig().camera;
  const MeasurementSigma sigma = measurement_sigma(*ray.node->keyframe, *ray.feature);
  const Eigen::Matrix3d r = ray.camera_from_map->rotation.toRotationMatrix();
  const Eigen::Vector3d& t = ray.camera_from_map->translation;
  const Eigen::Vector3d u = camera.unproject(ray.feature->pixel(), 1.0);
  const Eigen::Vector2d weight = Eigen::Vector2d(camera.fx, camera.fy) / (depth * sigma.pixel);
  for (int i = 0; i < 2; ++i)
    normal.add(weight[i] * (r.row(i) - u[i] * r.row(2)).transpose(),
               weight[i] * (u[i] * t.z() - t[i]));
  if (!ray.feature->has_depth()) return;
  // disparity z = fx baseline
  const double w = 1.0 / (depth * sigma.disparity);
  const double d = ray.feature->disparity;
  normal.add(w * d * r.row(2).transpose(), w * (camera.fx * camera.baseline - d * t.z()));
}

}  // namespace

std::optional<TwoViewPoint> triangulate_two_views(const Ray& a, const Ray& b) {
  const std::array<const Ray*, 2> rays{&a, &b};
  std::array<double, 2> depth{1.0, 1.0};
  TwoViewPoint point{};
  for (int round = 0; round < kRounds; ++round) {
    Normal normal;
    for (std::size_t i = 0; i < 2; ++i) add_rows(*rays[i], depth[i], normal);
    // The direct solver for 3x3: closed form, and its eigenvalues tell how certain the point is.
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(normal.information);
    const double least = solver.eigenvalues()[0];
    if (!(least > 1e-12 * solver.eigenvalues()[2])) return std::nullopt;
    point.position = normal.information.ldlt().solve(normal.right);
    for (std::size_t i = 0; i < 2; ++i) {
      const Rigid3& camera_from_map = *rays[i]->camera_from_map;
      depth[i] = (camera_from_map.rotation * point.position + camera_from_map.translation).z();
      if (!(depth[i] > 0)) return std::nullopt;
    }
    const double distance = std::min((a.node->map_from_camera.origin() - point.position).norm(),
                                     (b.node->map_from_camera.origin() - point.position).norm());
    point.relative_sigma = 1.0 / (std::sqrt(least) * distance);
  }
  if (!point.position.allFinite()) return std::nullopt;
  return point;
}

}  // namespace cairn
