#include "tests/unit/server/optimize/bare_ba.h"

#include <ceres/ceres.h>

namespace cairn::bare {
namespace {

struct Error {
  const Problem* problem;
  const Observation* seen;

  template <typename T>
  bool operator()(const T* rotation, const T* translation, const T* point, T* errors) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(rotation);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t(translation), x(point);
    const Eigen::Matrix<T, 3, 1> p = q.conjugate() * Eigen::Matrix<T, 3, 1>(x - t);
    errors[0] = problem->fx * p.x() / p.z() + problem->cx - seen->u;
    errors[1] = problem->fy * p.y() / p.z() + problem->cy - seen->v;
    errors[2] = problem->fx_baseline / p.z() - seen->disparity;
    return true;
  }
};

}  // namespace

Summary solve(Problem& problem, int first_iterations, int second_iterations,
              double function_tolerance) {
  Summary summary;
  for (const bool robust : {true, false}) {
    ceres::Problem ceres_problem;
    for (const Observation& seen : problem.observations)
      ceres_problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Error, 3, 4, 3, 3>(new Error{&problem, &seen}),
          robust ? new ceres::HuberLoss(2.7955) : nullptr, &problem.rotations[4 * seen.camera],
          &problem.translations[3 * seen.camera], &problem.points[3 * seen.point]);
    for (std::size_t c = 0; 4 * c < problem.rotations.size(); ++c)
      ceres_problem.SetManifold(&problem.rotations[4 * c], new ceres::EigenQuaternionManifold);
    ceres_problem.SetParameterBlockConstant(problem.rotations.data());
    ceres_problem.SetParameterBlockConstant(problem.translations.data());

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
