#include "common/feature/two_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

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

MeasurementSigma sigma_of(const View& view, const Feature& feature) {
  const MeasurementSigma usual = measurement_sigma(*view.rig, feature);
  return {view.noise * usual.pixel, view.noise * usual.disparity};
}

// Rows in pixels over their standard deviation. With the camera's rotation R and translation t, the
// point X has depth z = R3 X + t3, and u = (pixel - c) / f gives (R1 - u R3) X = u t3 - t1.
void add_rows(const View& view, const Feature& feature, double depth, Normal& normal) {
  const PinholeCamera& camera = view.rig->camera;
  const MeasurementSigma sigma = sigma_of(view, feature);
  const Eigen::Matrix3d r = view.camera_from_map.rotation.toRotationMatrix();
  const Eigen::Vector3d& t = view.camera_from_map.translation;
  const Eigen::Vector3d u = camera.unproject(feature.pixel(), 1.0);
  const Eigen::Vector2d weight = Eigen::Vector2d(camera.fx, camera.fy) / (depth * sigma.pixel);
  for (int i = 0; i < 2; ++i)
    normal.add(weight[i] * (r.row(i) - u[i] * r.row(2)).transpose(),
               weight[i] * (u[i] * t.z() - t[i]));
  if (!feature.has_depth()) return;
  // disparity z = fx baseline
  const double w = 1.0 / (depth * sigma.disparity);
  const double d = feature.disparity;
  normal.add(w * d * r.row(2).transpose(), w * (camera.fx * camera.baseline - d * t.z()));
}

}  // namespace

std::optional<TwoViewPoint> triangulate_two_views(const View& a, const Feature& in_a, const View& b,
                                                  const Feature& in_b) {
  const std::array<const View*, 2> views{&a, &b};
  const std::array<const Feature*, 2> features{&in_a, &in_b};
  std::array<double, 2> depth{1.0, 1.0};
  TwoViewPoint point{};
  for (int round = 0; round < kRounds; ++round) {
    Normal normal;
    for (std::size_t i = 0; i < 2; ++i) add_rows(*views[i], *features[i], depth[i], normal);
    // The direct solver for 3x3: closed form, and its eigenvalues tell how certain the point is.
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(normal.information);
    const double least = solver.eigenvalues()[0];
    if (!(least > 1e-12 * solver.eigenvalues()[2])) return std::nullopt;
    point.position = normal.information.ldlt().solve(normal.right);
    for (std::size_t i = 0; i < 2; ++i) {
      depth[i] = (views[i]->camera_from_map * point.position).z();
      if (!(depth[i] > 0)) return std::nullopt;
    }
    const double distance = std::min((a.camera_from_map * point.position).norm(),
                                     (b.camera_from_map * point.position).norm());
    point.relative_sigma = 1.0 / (std::sqrt(least) * distance);
  }
  if (!point.position.allFinite()) return std::nullopt;
  return point;
}

double reprojection_chi2(const View& view, const Feature& feature,
                         const Eigen::Vector3d& point_in_map) {
  const Eigen::Vector3d p = view.camera_from_map * point_in_map;
  if (!(p.z() > 0)) return std::numeric_limits<double>::infinity();
  const PinholeCamera& camera = view.rig->camera;
  const MeasurementSigma sigma = sigma_of(view, feature);
  double chi2 = ((camera.project(p) - feature.pixel()) / sigma.pixel).squaredNorm();
  if (feature.has_depth()) {
    const double error = (camera.disparity(p.z()) - feature.disparity) / sigma.disparity;
    chi2 += error * error;
  }
  return chi2;
}

}  // namespace cairn
