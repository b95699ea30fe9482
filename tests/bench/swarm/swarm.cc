// ./dev bench swarm: how one server does with more and more clients.
//
// Clients walk through one synthetic scene, each on a way of its own. Their keyframes were recorded
// beforehand and are replayed in real time through the real link, so that the machine's processors
// are the server's: tracking for twelve cameras is no part of the load. For each number of clients
// a fresh server runs with a map file, and a row says how exact the keyframes' poses are (each
// client by itself, and all with one alignment), when the parts of the map were merged, what went
// over the link, how long a keyframe's correction took and how many waited, and what the server
// cost. Some may flood it: send all that they have at once. What the others feel of it is then the
// question, and the row speaks of them (poses, merges and the server's cost are of all).
#include <cstdio>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <CLI/CLI.hpp>

#include "server/tool/evaluation.h"
#include "tests/bench/swarm/bench_server.h"
#include "tests/bench/swarm/overlap.h"
#include "tests/bench/swarm/quantile.h"
#include "tests/bench/swarm/recorded_walk.h"
#include "tests/bench/swarm/replayed_client.h"

namespace cairn::bench {
namespace {

struct Arguments {
  std::vector<int> clients{1, 2, 4, 8, 12};
  std::string scene = "desk";
  int frames = 600;
  double keyframes_per_s = 3;
  int flooding = 0;  // so many of the clients, the last ones
  std::filesystem::path recordings = "build/bench/swarm";
  std::string keep_log;  // empty: not kept
  std::string log_level = "info";
  std::string config;  // of the server; empty: the defaults
};

constexpr double kFlood = 1000;  // keyframes a second

struct Outcome {
  std::vector<ReplayResult> clients;
  std::size_t even = 0;  // so many of them, the first ones, kept to the pace
  Usage usage;
  double seconds = 0;
  std::string log;
  Map map;
};

// Seconds; "-" where there is no such delay.
std::string delay(const std::optional<WallTime>& from, const std::optional<WallTime>& to) {
  if (!from || !to) return "-";
  return fmt::format("{:.1f}", std::chrono::duration<double>(*to - *from).count());
}

Result<Outcome> run_swarm(const Arguments& arguments, const std::vector<RecordedWalk>& walks) {
  std::vector<std::string> options{"--log-level", arguments.log_level};
  if (!arguments.config.empty()) options.insert(options.end(), {"--config", arguments.config});
  auto server = BenchServer::start(options);
  if (!server) return server.error();
  Outcome outcome;
  outcome.even =
      walks.size() - std::min(walks.size() - 1, static_cast<std::size_t>(arguments.flooding));
  std::vector<std::unique_ptr<ReplayedClient>> clients;
  for (const RecordedWalk& walk : walks) {
    const double pace = clients.size() < outcome.even ? arguments.keyframes_per_s : kFlood;
    auto client = ReplayedClient::make(walk, pace, (*server)->file(walk.name), (*server)->node());
    if (!client) return client.error();
    clients.push_back(std::move(*client));
  }
  std::this_thread::sleep_for(std::chrono::seconds(1));  // until they have found each other
  const Usage before = (*server)->usage();
  const auto started = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < clients.size(); ++i)
    clients[i]->start(std::chrono::nanoseconds(static_cast<std::int64_t>(
        1e9 * static_cast<double>(i) /
        (arguments.keyframes_per_s * static_cast<double>(clients.size())))));
  for (const auto& client : clients) outcome.clients.push_back(client->finish());
  outcome.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  outcome.usage = (*server)->usage();
  outcome.usage.cpu_s -= before.cpu_s;
  if (Status s = (*server)->stop(); !s) return s.error();
  outcome.log = (*server)->log();
  Result<Map> map = (*server)->map();
  if (!map) return map.error();
  outcome.map = std::move(*map);
  return outcome;
}

double rmse(const Result<Evaluation>& evaluation) {
  return evaluation ? evaluation->ate.rmse : INFINITY;
}

struct Errors {
  double least = INFINITY, most = 0, joint = NAN;  // ATE, metres
};

Errors errors_of(const Outcome& outcome, const std::vector<RecordedWalk>& walks) {
  Errors errors;
  std::vector<EvaluationInput> inputs;
  for (std::size_t i = 0; i < walks.size(); ++i) {
    inputs.push_back({&walks[i].truth, &outcome.clients[i].keyframes});
    const double one = rmse(evaluate(walks[i].truth, outcome.clients[i].keyframes));
    errors.least = std::min(errors.least, one);
    errors.most = std::max(errors.most, one);
  }
  errors.joint = rmse(evaluate_joint(inputs));
  return errors;
}

void tell(const Outcome& outcome, const std::vector<RecordedWalk>& walks) {
  const Errors errors = errors_of(outcome, walks);
  std::vector<double> corrections;
  double up = 0, down = 0, keyframes = 0;
  std::size_t early = 0, late = 0;
  bool settled = true;
  for (std::size_t i = 0; i < outcome.even; ++i) {
    const ReplayResult& client = outcome.clients[i];
    corrections.insert(corrections.end(), client.correction_ms.begin(), client.correction_ms.end());
    up += static_cast<double>(client.link.bytes_up) / 1000 / client.seconds;
    down += static_cast<double>(client.link.bytes_down) / 1000 / client.seconds;
    keyframes += static_cast<double>(client.sent.size()) / client.seconds;
    const auto middle =
        client.backlog.begin() + static_cast<std::ptrdiff_t>(client.backlog.size() / 2);
    early = std::max(early, *std::max_element(client.backlog.begin(), middle));
    late = std::max(late, *std::max_element(middle, client.backlog.end()));
  }
  for (const ReplayResult& client : outcome.clients) settled = settled && client.settled;
  const auto count = static_cast<double>(outcome.even);
  const Meetings met = find_meetings(walks, outcome.clients);
  const std::vector<WallTime> merges = merges_in(outcome.log);
  const bool one_map = merges.size() + 1 == walks.size();
  std::optional<WallTime> first, last;
  if (!merges.empty()) first = merges.front();
  if (one_map && !merges.empty()) last = merges.back();
  fmt::print(
      "| {} | {:.1f} | {} | {}, {} | {:.4f}-{:.4f} | {:.4f} | {:.0f} | {:.0f} | {:.0f} | {:.0f} | "
      "{}, {} | {:.0f} | {:.0f} | {} |\n",
      walks.size(), keyframes, merges.size(), delay(met.first, first), delay(met.all, last),
      errors.least, errors.most, errors.joint, up / count, down / count, quantile(corrections, 0.5),
      quantile(corrections, 0.95), early, late, 100 * outcome.usage.cpu_s / outcome.seconds,
      outcome.usage.memory_mb, settled ? "yes" : "no");
}

int fail(const std::string& message) {
  fmt::print(stderr, "swarm: {}\n", message);
  return 2;
}

int run(const Arguments& arguments) {
  const int most = *std::max_element(arguments.clients.begin(), arguments.clients.end());
  const Result<std::vector<RecordedWalk>> recorded = record_walks(
      {.scene = arguments.scene, .frames = arguments.frames, .folder = arguments.recordings}, most,
      "swarm");
  if (!recorded) return fail(recorded.message());
  const std::vector<RecordedWalk>& walks = *recorded;
  fmt::print(
      "Scene {}, {} frames a client, replayed at {} keyframes a second each, but for {} that send "
      "all at once and of which poses, merges, cost and `settled` speak only. ATE of the "
      "keyframes; "
      "merged: seconds from when two clients had seen the same place to the first merge, and from "
      "when "
      "that connected all of them to the last one (before it, where less overlap was enough); "
      "correction: from a keyframe sent "
      "to the update that has it mapped; waiting: most of one client's keyframes in the first and "
      "in the second half; CPU in percent of one processor.\n\n"
      "| clients | keyframes/s | merges | merged s | ATE each m | joint m | up kB/s | down kB/s | "
      "correction p50 ms | p95 | waiting | server CPU % | server MB | settled |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
      arguments.scene, arguments.frames, arguments.keyframes_per_s, arguments.flooding);
  for (const int count : arguments.clients) {
    const std::vector<RecordedWalk> some(walks.begin(), walks.begin() + count);
    const Result<Outcome> outcome = run_swarm(arguments, some);
    if (!outcome) return fail(outcome.message());
    tell(*outcome, some);
    if (!arguments.keep_log.empty())
      std::ofstream(fmt::format("{}.{}", arguments.keep_log, count)) << outcome->log;
  }
  return 0;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("Many clients at one server", "cairn_swarm_bench");
  cairn::bench::Arguments arguments;
  app.add_option("--clients", arguments.clients, "How many, one or several numbers")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--scene", arguments.scene, "Synthetic scene")->capture_default_str();
  app.add_option("--frames", arguments.frames, "Of each walk")->capture_default_str();
  app.add_option("--keyframes-per-s", arguments.keyframes_per_s, "Of each client")
      ->capture_default_str();
  app.add_option("--flooding", arguments.flooding,
                 "Of the clients, how many send all at once; one never does")
      ->check(CLI::Range(0, 63))
      ->capture_default_str();
  app.add_option("--recordings", arguments.recordings, "Folder where walks are kept")
      ->capture_default_str();
  app.add_option("--keep-log", arguments.keep_log,
                 "Write the server's log to this file, .N behind");
  app.add_option("--log-level", arguments.log_level, "Of the server")->capture_default_str();
  app.add_option("--config", arguments.config, "Of the server");
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return cairn::bench::run(arguments);
}
