#include "server/optimize/relative_pose.h"

#include <array>
#include <cmath>
#include <limits>

#include <ceres/ceres.h>

#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

constexpr double kMinDepth = 0.02;  // metres; nearer is inside the lens

// Whitened error of a sight. a_from_b: quaternion x y z w, translation, logarithm of the scale.
// Where the point lies behind the camera no error can be told.
template <typename T>
bool sight_error(const Sight& sight, const Eigen::Matrix<T, 3, 1>& in_primary, T* errors) {
  const Eigen::Matrix<T, 3, 1> p =
      sight.camera_from_primary.rotation.template cast<T>() * in_primary +
      sight.camera_from_primary.translation.template cast<T>();
  if (!(p.z() > T(kMinDepth))) return false;
  errors[0] = sight.pixel_weight * (sight.fx * p.x() / p.z() + sight.cx - sight.u);
  errors[1] = sight.pixel_weight * (sight.fy * p.y() / p.z() + sight.cy - sight.v);
  if (sight.has_depth)
    errors[2] = sight.disparity_weight * (sight.fx_baseline / p.z() - sight.disparity);
  return true;
}

// `forward`: the sight is in group a, of a point of group b.
template <int kRows>
class SightError {
 public:
  SightError(const Sight& sight, bool forward) : sight_(&sight), forward_(forward) {}

  template <typename T>
  bool operator()(const T* q, const T* t, const T* log_scale, T* errors) const {
    const Eigen::Map<const Eigen::Quaternion<T>> rotation(q);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> translation(t);
    const Eigen::Matrix<T, 3, 1> point = sight_->point.template cast<T>();
    const Eigen::Matrix<T, 3, 1> moved =
        forward_ ? Eigen::Matrix<T, 3, 1>(exp(*log_scale) * (rotation * point) + translation)
                 : Eigen::Matrix<T, 3, 1>(
                       exp(-*log_scale) *
                       (rotation.conjugate() * Eigen::Matrix<T, 3, 1>(point - translation)));
    if (sight_error(*sight_, moved, errors)) return true;
    for (int i = 0; i < kRows; ++i) errors[i] = T(0);
    return true;
  }

 private:
  const Sight* sight_;
  bool forward_;
};

struct Unknown {
  std::array<double, 4> rotation;  // x y z w
  std::array<double, 3> translation;
  double log_scale;
};

template <int kRows>
void add_rows(ceres::Problem& problem, const Sight& sight, bool forward, ceres::LossFunction* loss,
              Unknown& x) {
  using Error = SightError<kRows>;
  problem.AddResidualBlock(
      new ceres::AutoDiffCostFunction<Error, kRows, 4, 3, 1>(new Error(sight, forward)), loss,
      x.rotation.data(), x.translation.data(), &x.log_scale);
}

void add(ceres::Problem& problem, const Sight& sight, bool forward, ceres::LossFunction* loss,
         Unknown& x) {
  if (sight.has_depth)
    add_rows<3>(problem, sight, forward, loss, x);
  else
    add_rows<2>(problem, sight, forward, loss, x);
}

}  // namespace

Sight::Sight(const Eigen::Vector3d& point_in_other, const Keyframe& keyframe,
             const Feature& feature, const Rigid3& camera, double slack)
    : point(point_in_other), camera_from_primary(camera) {
  const PinholeCamera& c = keyframe.rig->camera;
  fx = c.fx;
  fy = c.fy;
  cx = c.cx;
  cy = c.cy;
  fx_baseline = c.fx * c.baseline;
  u = feature.x;
  v = feature.y;
  disparity = feature.disparity;
  has_depth = feature.has_depth() && c.baseline > 0;
  const MeasurementSigma sigma = measurement_sigma(keyframe, feature);
  pixel_weight = 1 / (slack * sigma.pixel);
  disparity_weight = 1 / (slack * sigma.disparity);
}

double Sight::chi2(const Sim3& primary_from_other) const {
  double errors[3] = {0, 0, 0};
  if (!sight_error<double>(*this, primary_from_other * point, errors))
    return std::numeric_limits<double>::infinity();
  return errors[0] * errors[0] + errors[1] * errors[1] + errors[2] * errors[2];
}

std::optional<Sim3> refine_relative_pose(const Sim3& a_from_b, std::span<const SharedPoint> points,
                                         const RelativePoseOptions& options) {
  if (points.size() < 3) return std::nullopt;
  const auto& q = a_from_b.rotation;
  const auto& t = a_from_b.translation;
  Unknown x{{q.x(), q.y(), q.z(), q.w()}, {t.x(), t.y(), t.z()}, std::log(a_from_b.scale)};

  ceres::HuberLoss huber(options.huber);
  ceres::EigenQuaternionManifold manifold;
  ceres::Problem::Options ownership;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  for (const SharedPoint& point : points) {
    add(problem, point.in_a, true, &huber, x);
    add(problem, point.in_b, false, &huber, x);
  }
  problem.SetManifold(x.rotation.data(), &manifold);
  if (options.fix_scale) problem.SetParameterBlockConstant(&x.log_scale);

  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.max_num_iterations = options.max_iterations;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  const Eigen::Quaterniond rotation(x.rotation[3], x.rotation[0], x.rotation[1], x.rotation[2]);
  return Sim3(rotation.normalized(), Eigen::Map<const Eigen::Vector3d>(x.translation.data()),
              std::exp(x.log_scale));
}

}  // namespace cairn
