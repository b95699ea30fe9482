// ./dev bench soak: what a server becomes when people walk about one room for an hour.
//
// Clients on walks of their own through one synthetic scene, lap after lap. A lap replays recorded
// keyframes as new runs, which the server has never heard of and must find in what it has; it is
// replayed faster than it was walked. A row says how large map, file and server are by then, and
// how long corrections took: none of it may grow with the time.
#include <cmath>
#include <cstdio>

#include <algorithm>
#include <filesystem>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "server/tool/evaluation.h"
#include "tests/bench/swarm/bench_server.h"
#include "tests/bench/swarm/quantile.h"
#include "tests/bench/swarm/recorded_walk.h"
#include "tests/bench/swarm/replayed_client.h"

namespace cairn::bench {
namespace {

struct Arguments {
  std::string scene = "desk";
  int clients = 2;   // at a time
  int walks = 6;     // that are taken in turn
  int frames = 450;  // of each
  double minutes = 60;
  double keyframes_per_s = 10;
  std::filesystem::path recordings = "build/bench/swarm";
};

struct Lap {
  std::vector<double> correction_ms;
  std::size_t waiting = 0;  // most of one client's keyframes
  double worst = 0;         // ATE of a client's keyframes, metres
  double simulated_s = 0;   // of walking, all clients together
  bool settled = true;
};

class Soak {
 public:
  Soak(const Arguments& arguments, const std::vector<RecordedWalk>& walks, BenchServer& server)
      : arguments_(arguments), walks_(walks), server_(server) {}

  Result<Lap> lap() {
    std::vector<RecordedWalk> now;
    for (int i = 0; i < arguments_.clients; ++i, ++runs_)
      now.push_back(as_new_run(walks_[static_cast<std::size_t>(runs_) % walks_.size()],
                               fmt::format("walker{}", i),
                               1000 + static_cast<std::uint64_t>(runs_)));
    std::vector<std::unique_ptr<ReplayedClient>> clients;
    for (const RecordedWalk& walk : now) {
      auto client = ReplayedClient::make(walk, arguments_.keyframes_per_s, server_.file(walk.name),
                                         server_.node());
      if (!client) return client.error();
      clients.push_back(std::move(*client));
    }
    for (const auto& client : clients) client->start({});
    Lap lap;
    for (std::size_t i = 0; i < clients.size(); ++i) {
      add(clients[i]->finish(), now[i], lap);
      lap.simulated_s += static_cast<double>(arguments_.frames) / 30;
    }
    return lap;
  }

 private:
  static void add(const ReplayResult& result, const RecordedWalk& walk, Lap& lap) {
    lap.correction_ms.insert(lap.correction_ms.end(), result.correction_ms.begin(),
                             result.correction_ms.end());
    lap.waiting =
        std::max(lap.waiting, *std::max_element(result.backlog.begin(), result.backlog.end()));
    const auto evaluation = evaluate(walk.truth, result.keyframes);
    lap.worst = std::max(lap.worst, evaluation ? evaluation->ate.rmse : INFINITY);
    lap.settled = lap.settled && result.settled;
  }

  const Arguments& arguments_;
  const std::vector<RecordedWalk>& walks_;
  BenchServer& server_;
  int runs_ = 0;
};

int fail(const std::string& message) {
  fmt::print(stderr, "soak: {}\n", message);
  return 2;
}

int run(const Arguments& arguments) {
  const Result<std::vector<RecordedWalk>> recorded = record_walks(
      {.scene = arguments.scene, .frames = arguments.frames, .folder = arguments.recordings},
      arguments.walks, "soak");
  if (!recorded) return fail(recorded.message());
  const std::vector<RecordedWalk>& walks = *recorded;
  auto server = BenchServer::start({});
  if (!server) return fail(server.message());
  fmt::print(
      "Scene {}, {} clients at a time on {} walks of {} frames, replayed at {} keyframes a second "
      "each, every lap as new runs.\n\n"
      "| minutes walked | keyframes sent | in the map | landmarks | server MB | map file MB | "
      "correction p50 ms | p95 | waiting | worst ATE m | settled |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|\n",
      arguments.scene, arguments.clients, arguments.walks, arguments.frames,
      arguments.keyframes_per_s);
  Soak soak(arguments, walks, **server);
  double walked_s = 0, next_row_s = 0;
  std::size_t sent = 0;
  while (walked_s < 60 * arguments.minutes) {
    const Result<Lap> lap = soak.lap();
    if (!lap) return fail(lap.message());
    walked_s += lap->simulated_s;
    sent += lap->correction_ms.size();
    if (walked_s < next_row_s) continue;
    next_row_s += arguments.minutes * 60 / 12;
    const Result<MapSize> size = (*server)->map_size();
    if (!size) return fail(size.message());
    const auto file_mb =
        static_cast<double>(std::filesystem::file_size((*server)->file("map.db"))) / 1e6;
    fmt::print("| {:.1f} | {} | {} | {} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | {} | {:.4f} | {} |\n",
               walked_s / 60, sent, size->keyframes, size->landmarks, (*server)->usage().memory_mb,
               file_mb, quantile(lap->correction_ms, 0.5), quantile(lap->correction_ms, 0.95),
               lap->waiting, lap->worst, lap->settled ? "yes" : "no");
  }
  if (Status s = (*server)->stop(); !s) return fail(s.message());
  return 0;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("An hour in one room", "cairn_soak_bench");
  cairn::bench::Arguments arguments;
  app.add_option("--scene", arguments.scene, "Synthetic scene")->capture_default_str();
  app.add_option("--clients", arguments.clients, "At a time")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  app.add_option("--walks", arguments.walks, "Recorded walks, taken in turn")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--frames", arguments.frames, "Of each walk")->capture_default_str();
  app.add_option("--minutes", arguments.minutes, "Of walking, of all clients together")
      ->capture_default_str();
  app.add_option("--keyframes-per-s", arguments.keyframes_per_s, "Of each client")
      ->capture_default_str();
  app.add_option("--recordings", arguments.recordings, "Folder where walks are kept")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return cairn::bench::run(arguments);
}
