// The part of the pose graph that knows Ceres.
#include <array>
#include <cmath>

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include "server/optimize/pose_graph_problem.h"
#include "server/optimize/stop_callback.h"

namespace cairn {
namespace {

// Quaternion x y z w, translation, logarithm of the scale.
using State = std::array<double, 8>;

State to_state(const Sim3& s) {
  const auto& q = s.rotation;
  const auto& t = s.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z(), std::log(s.scale)};
}

Sim3 to_sim3(const State& s) {
  return {Eigen::Quaterniond(s[3], s[0], s[1], s[2]).normalized(),
          Eigen::Vector3d(s[4], s[5], s[6]), std::exp(s[7])};
}

// Logarithm of a rotation, for any scalar; the shorter way round.
template <typename T>
Eigen::Matrix<T, 3, 1> rotation_log(const Eigen::Quaternion<T>& q) {
  const T wxyz[4] = {q.w(), q.x(), q.y(), q.z()};
  Eigen::Matrix<T, 3, 1> omega;
  ceres::QuaternionToAngleAxis(wxyz, omega.data());
  return omega;
}

class EdgeError {
 public:
  EdgeError(const Sim3& to_from_from, double weight, const PoseGraphOptions& o)
      : measured_(to_from_from),
        rotation_weight_(std::sqrt(weight) / o.rotation_sigma),
        translation_weight_(std::sqrt(weight) / o.translation_sigma),
        scale_weight_(o.with_scale ? std::sqrt(weight) / o.scale_sigma : 0) {}

  // The predicted S_to^-1 S_from against the measured one, in the frame of `to`.
  template <typename T>
  bool operator()(const T* from, const T* to, T* errors) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q_from(from), q_to(to);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t_from(from + 4), t_to(to + 4);
    const Eigen::Quaternion<T> to_from_map = q_to.conjugate();
    const Eigen::Quaternion<T> turn =
        measured_.rotation.conjugate().template cast<T>() * (to_from_map * q_from);
    const Eigen::Matrix<T, 3, 1> offset =
        exp(-to[7]) * (to_from_map * Eigen::Matrix<T, 3, 1>(t_from - t_to));
    Eigen::Map<Eigen::Matrix<T, 7, 1>> e(errors);
    e.template head<3>() = rotation_weight_ * rotation_log(turn);
    e.template segment<3>(3) =
        translation_weight_ * (offset - measured_.translation.template cast<T>());
    e[6] = scale_weight_ * (from[7] - to[7] - std::log(measured_.scale));
    return true;
  }

 private:
  Sim3 measured_;
  double rotation_weight_, translation_weight_, scale_weight_;
};

using RigidNode = ceres::ProductManifold<ceres::EigenQuaternionManifold,
                                         ceres::EuclideanManifold<3>, ceres::SubsetManifold>;
using ScaledNode = ceres::ProductManifold<ceres::EigenQuaternionManifold,
                                          ceres::EuclideanManifold<3>, ceres::EuclideanManifold<1>>;

ceres::Manifold* make_manifold(bool with_scale) {
  if (with_scale) return new ScaledNode;
  return new RigidNode(ceres::EigenQuaternionManifold{}, ceres::EuclideanManifold<3>{},
                       ceres::SubsetManifold(1, {0}));
}

ceres::Problem::Options shared_ownership() {
  ceres::Problem::Options options;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  return options;
}

ceres::Solver::Options solver_options(const PoseGraphOptions& options) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.num_threads = options.num_threads;
  solver.logging_type = ceres::SILENT;
  return solver;
}

}  // namespace

double edge_error(const Sim3& map_from_from, const Sim3& map_from_to, const Sim3& to_from_from,
                  double weight, const PoseGraphOptions& options) {
  const State from = to_state(map_from_from), to = to_state(map_from_to);
  Eigen::Matrix<double, 7, 1> errors;
  EdgeError(to_from_from, weight, options)(from.data(), to.data(), errors.data());
  return errors.norm();
}

double edge_error(const PoseGraphProblem& problem, const PoseGraphProblem::Edge& edge,
                  const PoseGraphOptions& options) {
  return edge_error(problem.nodes[edge.from].state, problem.nodes[edge.to].state, edge.to_from_from,
                    edge.weight, options);
}

void solve_round(PoseGraphProblem& problem, const PoseGraphOptions& options, bool robust,
                 PoseGraphSummary& summary, const std::stop_token& stop) {
  const std::unique_ptr<ceres::Manifold> manifold(make_manifold(options.with_scale));
  ceres::HuberLoss huber(options.huber);
  std::vector<State> states;
  for (const auto& node : problem.nodes) states.push_back(to_state(node.state));

  ceres::Problem graph(shared_ownership());
  for (std::size_t i = 0; i < states.size(); ++i) {
    graph.AddParameterBlock(states[i].data(), 8, manifold.get());
    if (problem.nodes[i].fixed) graph.SetParameterBlockConstant(states[i].data());
  }
  for (const auto& edge : problem.edges) {
    if (!edge.active) continue;
    graph.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeError, 7, 8, 8>(
                               new EdgeError(edge.to_from_from, edge.weight, options)),
                           robust && edge.is_loop ? &huber : nullptr, states[edge.from].data(),
                           states[edge.to].data());
  }
  ceres::Solver::Options solver = solver_options(options);
  StopCallback callback(stop);
  solver.callbacks.push_back(&callback);
  ceres::Solver::Summary result;
  ceres::Solve(solver, &graph, &result);

  summary.usable = result.IsSolutionUsable();
  summary.iterations += std::max(0, static_cast<int>(result.iterations.size()) - 1);
  summary.final_cost = result.final_cost;
  summary.message = result.message;
  if (robust) summary.initial_cost = result.initial_cost;
  if (!summary.usable) return;
  for (std::size_t i = 0; i < states.size(); ++i) problem.nodes[i].state = to_sim3(states[i]);
}

}  // namespace cairn
