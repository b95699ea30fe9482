// Local bundle adjustment, from taking the problem out of the map to the finished delta, on windows
// of growing size. CPU time is what to look at on a machine that does other things too.
#include <benchmark/benchmark.h>

#include "server/optimize/local_ba.h"
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

}  // namespace
}  // namespace cairn
BENCHMARK_MAIN();
