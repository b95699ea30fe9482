// What the solvers cost, from taking the problem out of the map to the finished delta: local bundle
// adjustment on windows of growing size; global bundle adjustment of a large map, next to a program
// of Ceres alone on the same numbers; the pose graph that closes a long loop. CPU time is what to
// look at on a machine that does other things too.
#include <benchmark/benchmark.h>

#include <unordered_map>

#include "server/optimize/global_ba.h"
#include "server/optimize/local_ba.h"
#include "server/optimize/pose_graph.h"
#include "tests/bench/ring_problem.h"
#include "tests/unit/server/optimize/known_map.h"

namespace cairn {
namespace {

// range(0): free keyframes (as many are fixed), range(1): points, range(2): sensor.
void local_ba(benchmark::State& state) {
  const auto free = static_cast<int>(state.range(0));
  SyntheticMap world({.keyframes = 2 * free,
                      .points = static_cast<int>(state.range(1)),
                      .sensor = static_cast<Sensor>(state.range(2)),
                      .step = 0.05});
  Map map = known_map(world, 4, 20);
  const LocalWindow window = window_of(world, map, free);
  disturb(map, window.free_keyframes, 0.005, 0.02, 0.03);
  LocalBaSummary summary;
  for (auto _ : state) benchmark::DoNotOptimize(solve_local_ba(map, window, {}, &summary));
  state.counters["observations"] = summary.observations;
  state.counters["outliers"] = summary.outliers;
  state.counters["landmarks"] = summary.landmarks;
  state.counters["iterations"] = summary.iterations;
  state.counters["extract_ms"] = summary.extract_ms;
  state.counters["final_cost"] = summary.final_cost;
}
BENCHMARK(local_ba)
    ->Unit(benchmark::kMillisecond)
    ->Args({5, 600, 0})
    ->Args({10, 3500, 0})
    ->Args({10, 3500, 1})
    ->Args({10, 3500, 2})
    ->Args({20, 6000, 0});

const RingWorld& ring_world() {
  static const RingWorld world({});
  return world;
}

void global_ba(benchmark::State& state) {
  const RingWorld& world = ring_world();
  GlobalBaSummary summary;
  MapDelta delta;
  for (auto _ : state) delta = solve_global_ba(world.map, {}, {}, &summary);
  std::unordered_map<KeyframeId, Rigid3> poses;
  for (const auto& change : delta.poses) poses[change.keyframe] = change.map_from_camera;
  poses[RingWorld::id(0)] = world.truth[0];
  state.counters["keyframes"] = summary.keyframes;
  state.counters["landmarks"] = summary.landmarks;
  state.counters["observations"] = summary.observations;
  state.counters["iterations"] = summary.iterations;
  state.counters["initial_cost"] = summary.initial_cost;
  state.counters["final_cost"] = summary.final_cost;
  state.counters["outliers"] = summary.outliers;
  state.counters["rmse_before_mm"] =
      1000 * world.error([&](KeyframeId id) { return world.map.keyframes.at(id).map_from_camera; });
  state.counters["rmse_mm"] = 1000 * world.error([&](KeyframeId id) { return poses.at(id); });
}
BENCHMARK(global_ba)->Unit(benchmark::kSecond)->Iterations(1);

// range(0): 0 with automatic derivatives, 1 with analytic ones, so that what our data structures
// cost is told apart from what the derivatives do.
void global_ba_bare(benchmark::State& state) {
  const RingWorld& world = ring_world();
  const BundleOptions options = GlobalBaOptions{}.bundle;
  bare::Problem problem = bare_problem(world);
  bare::Summary summary;
  for (auto _ : state)
    summary = bare::solve(problem, static_cast<bare::Derivatives>(state.range(0)),
                          options.first_iterations, options.second_iterations,
                          options.function_tolerance);
  state.counters["observations"] = static_cast<double>(problem.observations.size());
  state.counters["iterations"] = summary.iterations;
  state.counters["initial_cost"] = summary.initial_cost;
  state.counters["final_cost"] = summary.final_cost;
  state.counters["rmse_mm"] = 1000 * world.error([&](KeyframeId id) {
    const double* t = problem.translation(id.sequence);
    return Rigid3{Eigen::Quaterniond::Identity(), {t[0], t[1], t[2]}};
  });
}
BENCHMARK(global_ba_bare)
    ->Unit(benchmark::kSecond)
    ->Iterations(1)
    ->ArgName("analytic")
    ->Arg(0)
    ->Arg(1);

// A ring that has drifted apart by metres where it should close.
void pose_graph(benchmark::State& state) {
  const RingWorld world({.landmarks = 20000, .rounds = 1, .turn_error = 0, .move_error = 0});
  Map map = world.map;
  Rigid3 drift;
  for (int k = 1; k < world.options.keyframes; ++k) {
    drift = drift * Rigid3{so3_exp({0, 0.0002, 0}), {0.002, 0, 0.001}};
    map.keyframes.edit(RingWorld::id(k))->map_from_camera =
        world.truth[static_cast<std::size_t>(k)] * drift;
  }
  const RelativePose loop{RingWorld::id(world.options.keyframes - 1), RingWorld::id(0),
                          Sim3(world.truth.front().inverse() * world.truth.back())};
  PoseGraphSummary summary;
  for (auto _ : state) benchmark::DoNotOptimize(solve_pose_graph(map, {&loop, 1}, {}, &summary));
  state.counters["edges"] = summary.edges;
  state.counters["iterations"] = summary.iterations;
  state.counters["initial_cost"] = summary.initial_cost;
  state.counters["final_cost"] = summary.final_cost;
  state.counters["rejected"] = static_cast<double>(summary.rejected.size());
}
BENCHMARK(pose_graph)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn
BENCHMARK_MAIN();
