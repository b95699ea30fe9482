#include "tests/unit/server/optimize/bare_ba.h"

#include <algorithm>

#include <ceres/ceres.h>

namespace cairn::bare {
namespace {

struct Error {
  const Problem* problem;
  const Observation* seen;

  template <typename T>
  bool operator()(const T* pose, const T* point, T* errors) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(pose);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t(pose + 4), x(point);
    const Eigen::Matrix<T, 3, 1> p = q.conjugate() * Eigen::Matrix<T, 3, 1>(x - t);
    errors[0] = problem->fx * p.x() / p.z() + problem->cx - seen->u;
    errors[1] = problem->fy * p.y() / p.z() + problem->cy - seen->v;
    errors[2] = problem->fx_baseline / p.z() - seen->disparity;
    return true;
  }
};

using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Matrix3 cross_matrix(const Eigen::Vector3d& v) {
  Matrix3 m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// The same errors. With u = -(x y z) of the quaternion and d = point - translation, the point in
// the camera is p = d + 2 w (u x d) + 2 u x (u x d).
class AnalyticError final : public ceres::SizedCostFunction<3, 7, 3> {
 public:
  AnalyticError(const Problem* problem, const Observation* seen) : problem_(problem), seen_(seen) {}

  bool Evaluate(double const* const* parameters, double* errors,
                double** jacobians) const override {
    const double w = parameters[0][3];
    const Eigen::Vector3d u = -Eigen::Map<const Eigen::Vector3d>(parameters[0]);
    const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(parameters[1]) -
                              Eigen::Map<const Eigen::Vector3d>(parameters[0] + 4);
    const Eigen::Vector3d ud = u.cross(d);
    const Eigen::Vector3d p = d + 2 * w * ud + 2 * u.cross(ud);
    const double fx = problem_->fx, fy = problem_->fy, inv_z = 1 / p.z();
    errors[0] = fx * p.x() * inv_z + problem_->cx - seen_->u;
    errors[1] = fy * p.y() * inv_z + problem_->cy - seen_->v;
    errors[2] = problem_->fx_baseline * inv_z - seen_->disparity;
    if (!jacobians) return true;

    Matrix3 by_p;
    by_p << fx * inv_z, 0, -fx * p.x() * inv_z * inv_z,  //
        0, fy * inv_z, -fy * p.y() * inv_z * inv_z,      //
        0, 0, -problem_->fx_baseline * inv_z * inv_z;
    const Matrix3 cross_u = cross_matrix(u);
    const Matrix3 turn = Matrix3::Identity() + 2 * w * cross_u + 2 * cross_u * cross_u;
    const Matrix3 by_point = by_p * turn;
    if (jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, 3, 7, Eigen::RowMajor>> by_pose(jacobians[0]);
      const Matrix3 cross_d = cross_matrix(d);
      by_pose.leftCols<3>() =
          by_p * (2 * w * cross_d + 2 * cross_matrix(ud) + 2 * cross_u * cross_d);
      by_pose.col(3) = by_p * (2 * ud);
      by_pose.rightCols<3>() = -by_point;
    }
    if (jacobians[1]) std::copy_n(by_point.data(), 9, jacobians[1]);
    return true;
  }

 private:
  const Problem* problem_;
  const Observation* seen_;
};

ceres::CostFunction* make_cost(const Problem& problem, const Observation& seen,
                               Derivatives derivatives) {
  if (derivatives == Derivatives::kAnalytic) return new AnalyticError(&problem, &seen);
  return new ceres::AutoDiffCostFunction<Error, 3, 7, 3>(new Error{&problem, &seen});
}

}  // namespace

Summary solve(Problem& problem, Derivatives derivatives, int first_iterations,
              int second_iterations, double function_tolerance) {
  Summary summary;
  for (const bool robust : {true, false}) {
    ceres::Problem ceres_problem;
    for (const Observation& seen : problem.observations)
      ceres_problem.AddResidualBlock(
          make_cost(problem, seen, derivatives), robust ? new ceres::HuberLoss(2.7955) : nullptr,
          &problem.poses[7 * seen.camera], &problem.points[3 * seen.point]);
    using PoseManifold =
        ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;
    for (std::size_t c = 0; 7 * c < problem.poses.size(); ++c)
      ceres_problem.SetManifold(&problem.poses[7 * c], new PoseManifold);
    ceres_problem.SetParameterBlockConstant(problem.poses.data());

    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.max_num_iterations = robust ? first_iterations : second_iterations;
    options.function_tolerance = function_tolerance;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary result;
    ceres::Solve(options, &ceres_problem, &result);
    if (robust) summary.initial_cost = result.initial_cost;
    summary.final_cost = result.final_cost;
    summary.iterations += static_cast<int>(result.iterations.size()) - 1;
  }
  return summary;
}

}  // namespace cairn::bare
