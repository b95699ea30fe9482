// What the server does with a map of some size besides solving: telling a client, saving, loading.
#include <filesystem>

#include <benchmark/benchmark.h>
#include <unistd.h>

#include "server/map/apply.h"
#include "server/publish/publish.h"
#include "server/storage/map_file.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

constexpr std::uint64_t kEpoch = 7;

// About 1000 features a keyframe, seen by its neighbours for a metre or two.
const Map& large_map() {
  static const Map map = [] {
    const SyntheticMap world(
        {.keyframes = 120, .points = 4000, .epoch = kEpoch, .step = 0.1, .length = 12});
    Map m;
    m.id = {1};
    for (const KeyframePtr& keyframe : world.keyframes) apply_keyframe(m, keyframe);
    return m;
  }();
  return map;
}

// As after local bundle adjustment: the landmarks of the latest keyframes have all moved a little.
Map with_local_changes(double distance) {
  Map map = large_map();
  MapDelta delta;
  delta.base_revision = map.revision;
  for (std::uint32_t s = 110; s < 120; ++s)
    for (const LandmarkId& id : map.keyframes.at({kEpoch, s}).landmarks)
      if (id.is_valid())
        delta.positions.push_back(
            {id, map.landmarks.at(id).position + Eigen::Vector3d(distance, 0, 0)});
  apply_delta(map, delta);
  return map;
}

void tell_changes(benchmark::State& state) {
  const Map before = large_map();
  const Map after = with_local_changes(state.range(0) * 1e-4);
  ClientView told(kEpoch);
  for (int i = 0; i < 10; ++i) told.difference(before, 120);
  std::size_t landmarks = 0;
  for (auto _ : state) {
    state.PauseTiming();
    ClientView view = told;
    state.ResumeTiming();
    const auto update = view.difference(after, 120);
    landmarks = update ? update->landmarks.size() : 0;
  }
  state.counters["landmarks"] = static_cast<double>(landmarks);
  state.counters["known"] = static_cast<double>(told.known_landmarks());
}
BENCHMARK(tell_changes)->Unit(benchmark::kMillisecond)->Arg(2)->Arg(50);

std::filesystem::path bench_file() {
  return std::filesystem::temp_directory_path() /
         ("cairn_map_bench_" + std::to_string(getpid()) + ".db");
}

// How long append() would have waited.
void tell_locking(benchmark::State& state, const WriteTimes& writing) {
  state.counters["locked_ms"] = writing.locked_ms;
  state.counters["longest_ms"] = std::max(writing.longest_ms, state.counters["longest_ms"].value);
  state.counters["pieces"] = static_cast<double>(writing.pieces);
}

void save_whole_map(benchmark::State& state) {
  for (auto _ : state) {
    auto file = MapFile::open(bench_file());
    const auto summary = (*file)->save_map(large_map());
    tell_locking(state, summary->writing);
    state.counters["landmarks"] = static_cast<double>(summary->landmarks);
  }
  state.counters["MB"] = static_cast<double>(std::filesystem::file_size(bench_file())) / 1e6;
  std::filesystem::remove(bench_file());
}
BENCHMARK(save_whole_map)->Unit(benchmark::kMillisecond)->Iterations(3);

void save_local_changes(benchmark::State& state) {
  auto file = MapFile::open(bench_file());
  const Map a = large_map(), b = with_local_changes(0.01);
  (void)(*file)->save_map(a);
  bool odd = false;
  for (auto _ : state) {
    odd = !odd;
    const auto summary = (*file)->save_map(odd ? b : a);
    tell_locking(state, summary->writing);
    state.counters["landmarks"] = static_cast<double>(summary->landmarks);
  }
  file->reset();
  std::filesystem::remove(bench_file());
}
BENCHMARK(save_local_changes)->Unit(benchmark::kMillisecond);

void load_map(benchmark::State& state) {
  (void)(*MapFile::open(bench_file()))->save_map(large_map());
  for (auto _ : state) {
    auto file = MapFile::open(bench_file());
    benchmark::DoNotOptimize((*file)->load_map());
  }
  std::filesystem::remove(bench_file());
}
BENCHMARK(load_map)->Unit(benchmark::kMillisecond);

// A large place: 1000 keyframes, 100 000 landmarks.
const Map& huge_map() {
  static const Map map = [] {
    Map m;
    m.id = {1};
    // In pieces, of clients that pass one after another: a piece looks at its own points only.
    for (std::uint64_t part = 0; part < 10; ++part) {
      const SyntheticMap world({.keyframes = 100,
                                .points = 28000,
                                .seed = part + 1,
                                .epoch = part + 1,
                                .step = 0.3,
                                .length = 30});
      for (const KeyframePtr& keyframe : world.keyframes) apply_keyframe(m, keyframe);
    }
    return m;
  }();
  return map;
}

// As after global bundle adjustment: everything has moved.
void save_moved_map(benchmark::State& state) {
  auto file = MapFile::open(bench_file());
  const Map& a = huge_map();
  Map b = a;
  MapDelta delta = MapDelta::based_on(a);
  for (const KeyframeId id : a.keyframes.sorted_keys()) {
    const Rigid3& old = a.keyframes.at(id).map_from_camera;
    delta.poses.push_back({id, old, old * Rigid3{{1, 0, 0, 0}, {0.01, 0, 0}}});
  }
  for (const LandmarkId id : a.landmarks.sorted_keys())
    delta.positions.push_back({id, a.landmarks.at(id).position + Eigen::Vector3d(0.01, 0, 0)});
  apply_delta(b, delta);
  (void)(*file)->save_map(a);
  bool odd = false;
  for (auto _ : state) {
    odd = !odd;
    const auto summary = (*file)->save_map(odd ? b : a);
    tell_locking(state, summary->writing);
    state.counters["landmarks"] = static_cast<double>(summary->landmarks);
  }
  file->reset();
  state.counters["file_MB"] = static_cast<double>(std::filesystem::file_size(bench_file())) / 1e6;
  std::filesystem::remove(bench_file());
}
BENCHMARK(save_moved_map)->Unit(benchmark::kMillisecond)->Iterations(4);

// Beside a file that holds the map already; each is of another event, so that old ones go.
void save_checkpoint(benchmark::State& state) {
  auto file = MapFile::open(bench_file());
  Map map = huge_map();
  (void)(*file)->save_map(map);
  for (auto _ : state) {
    const auto summary = (*file)->save_checkpoint(map);
    map.loops.emplace_back();
    tell_locking(state, summary->writing);
    state.counters["MB"] = static_cast<double>(summary->bytes) / 1e6;
  }
  state.counters["keyframes"] = static_cast<double>(map.keyframes.size());
  state.counters["landmarks"] = static_cast<double>(map.landmarks.size());
  file->reset();
  state.counters["file_MB"] = static_cast<double>(std::filesystem::file_size(bench_file())) / 1e6;
  std::filesystem::remove(bench_file());
}
BENCHMARK(save_checkpoint)->Unit(benchmark::kMillisecond)->Iterations(6);

void undo_event(benchmark::State& state) {
  auto file = MapFile::open(bench_file());
  Map map = huge_map();
  const Map before = map;
  LoopEdge& edge = map.loops.emplace_back();
  edge.query = {1, 5};
  edge.candidate = {1, 6};
  for (auto _ : state) {
    state.PauseTiming();
    (void)(*file)->save_map(map);
    (void)(*file)->save_checkpoint(before);
    state.ResumeTiming();
    const Status status = (*file)->restore(1);
    if (!status) state.SkipWithError(status.message().c_str());
  }
  file->reset();
  std::filesystem::remove(bench_file());
}
BENCHMARK(undo_event)->Unit(benchmark::kMillisecond)->Iterations(1);

void append_keyframe(benchmark::State& state) {
  auto file = MapFile::open(bench_file());
  const auto& keyframe = *large_map().keyframes.at({kEpoch, 60}).keyframe;
  const auto blob = wire::encode_keyframe("bench", keyframe);
  std::uint32_t sequence = 0;
  for (auto _ : state) (void)(*file)->append({"bench", kEpoch}, {kEpoch, sequence++}, *blob);
  state.counters["kB"] = static_cast<double>(blob->size()) / 1e3;
  file->reset();
  std::filesystem::remove(bench_file());
}
BENCHMARK(append_keyframe)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace cairn
BENCHMARK_MAIN();
