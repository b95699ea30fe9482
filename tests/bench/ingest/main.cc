// ./dev bench ingest: how soon keyframes are safe while the map is adjusted as a whole.
//
// A real server loads a map of 1000 keyframes and 100 000 landmarks. Three clients stream keyframes
// of places of their own; then the client that made the large map says that it has finished, and
// the server adjusts that part as a whole. Told is, for keyframes that were due meanwhile, the time
// until the client had the acknowledgement: its own outbox and both ways over the network included,
// so an upper bound of what passes between arrival and journal. The map is saved every few seconds.
#include <csignal>
#include <cstdio>

#include <algorithm>
#include <fstream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "tests/bench/ingest/ring_map_file.h"
#include "tests/bench/ingest/server_log.h"
#include "tests/bench/ingest/streams.h"
#include "tests/integration/process.h"
#include "tests/support/loopback.h"
#include "tests/support/temp_folder.h"

namespace cairn::bench {
namespace {

using std::chrono::seconds;
using std::chrono::system_clock;

struct Arguments {
  int clients = 3, rounds = 3, keyframes = 1000, landmarks = 100000;
  double rate = 4;
};

struct Round {
  double adjusting_s = 0;
  std::string adjusted;  // the server's words
  int local_solves = 0;
  std::vector<double> before_ms, during_ms;  // to the acknowledgement
};

bool is_in(system_clock::time_point t, system_clock::time_point from, system_clock::time_point to) {
  return t >= from && t <= to;
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const auto last = static_cast<double>(values.size() - 1);
  return values[static_cast<std::size_t>(std::ceil(share * last))];
}

// Until the server says that the map is adjusted. False: it did not within ten minutes.
bool wait_settled(Link& link) {
  const auto deadline = std::chrono::steady_clock::now() + seconds(600);
  while (std::chrono::steady_clock::now() < deadline)
    if (const auto update = link.wait_update(seconds(1)); update && update->settled) return true;
  return false;
}

Result<Round> read_log(const std::string& log, const std::vector<Acknowledged>& noted,
                       system_clock::time_point finishing) {
  const auto adjustments = solves_in(log, "global BA");
  if (adjustments.empty())
    return {ErrorCode::kInternal, "the server has not adjusted the map as a whole"};
  const LoggedSolve& adjusted = adjustments.front();
  const auto ended = adjusted.ended;
  const auto started =
      ended - std::chrono::duration_cast<system_clock::duration>(
                  std::chrono::duration<double, std::milli>(adjusted.milliseconds));
  Round round;
  round.adjusting_s = adjusted.milliseconds / 1000;
  round.adjusted = adjusted.line;
  for (const Acknowledged& a : noted) {
    if (is_in(a.due, started, ended)) round.during_ms.push_back(a.milliseconds);
    if (a.due < finishing) round.before_ms.push_back(a.milliseconds);
  }
  for (const LoggedSolve& solve : solves_in(log, "local BA"))
    round.local_solves += is_in(solve.ended, started, ended);
  return round;
}

Result<Round> run_round(const Arguments& arguments, const std::filesystem::path& ring) {
  const synthetic::TempFolder folder;
  std::filesystem::copy_file(ring, folder / "map.db");
  std::ofstream(folder / "server.yaml") << "log_level: debug\nsave_every_s: 5\n";
  const testing::Loopback net;
  const auto node = net.node();
  testing::Process server(std::string(CAIRN_BINARY_DIR) + "/cairn-server",
                          {"--config", folder / "server.yaml", "--map", folder / "map.db",
                           "--domain", std::to_string(node.domain)},
                          {"CYCLONEDDS_URI=" + node.config}, folder / "server");
  if (!server.wait_for_log("ready: ", seconds(60)))
    return {ErrorCode::kUnavailable, "cairn-server does not start: " + server.err()};
  std::vector<std::unique_ptr<Stream>> streams;
  for (int c = 1; c <= arguments.clients; ++c) {
    const std::string name = fmt::format("stream{}", c);
    auto stream = Stream::make({.name = name,
                                .number = static_cast<std::uint64_t>(c),
                                .keyframes_per_s = arguments.rate,
                                .outbox = folder / name,
                                .dds = net.node()});
    if (!stream) return stream.error();
    streams.push_back(std::move(*stream));
  }
  auto owner = connect(kRingClient, folder / "ring", net.node());
  if (!owner) return owner.error();
  for (const auto& stream : streams) stream->start();
  std::this_thread::sleep_for(seconds(5));  // what it is like without
  const auto finishing = system_clock::now();
  (*owner)->say_finishing();
  const bool settled = wait_settled(**owner);
  std::vector<Acknowledged> noted;
  for (const auto& stream : streams)
    for (const Acknowledged& a : stream->stop()) noted.push_back(a);
  (*owner)->stop();
  server.signal(SIGTERM);
  if (!settled || server.wait(seconds(60)) != 0)
    return {ErrorCode::kTimeout, "the server does not come to an end: " + server.err()};
  return read_log(server.err(), noted, finishing);
}

void tell(const std::string& name, const Round& round) {
  fmt::print("| {} | {:.1f} | {} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {:.1f} | {} |\n", name,
             round.adjusting_s, round.during_ms.size(), quantile(round.before_ms, 0.5),
             quantile(round.before_ms, 0.99), quantile(round.during_ms, 0.5),
             quantile(round.during_ms, 0.99), quantile(round.during_ms, 1), round.local_solves);
}

int run(const Arguments& arguments) {
  const synthetic::TempFolder folder;
  const auto ring = folder / "ring.db";
  if (Status s = write_ring_map(
          {.keyframes = arguments.keyframes, .landmarks = arguments.landmarks}, ring);
      !s) {
    fmt::print(stderr, "ingest: {}\n", s.message());
    return 2;
  }
  fmt::print(
      "{} clients at {} keyframes a second each; times from due to acknowledged\n\n"
      "| round | global BA s | keyframes during it | before: p50 ms | p99 | during: p50 | p99 | "
      "most | local BA solves during it |\n|---|---|---|---|---|---|---|---|---|\n",
      arguments.clients, arguments.rate);
  Round all;
  for (int r = 1; r <= arguments.rounds; ++r) {
    const auto round = run_round(arguments, ring);
    if (!round) {
      fmt::print(stderr, "ingest: {}\n", round.message());
      return 2;
    }
    tell(std::to_string(r), *round);
    all.adjusting_s += round->adjusting_s;
    all.adjusted = round->adjusted;
    all.local_solves += round->local_solves;
    all.before_ms.insert(all.before_ms.end(), round->before_ms.begin(), round->before_ms.end());
    all.during_ms.insert(all.during_ms.end(), round->during_ms.begin(), round->during_ms.end());
  }
  tell("all", all);
  fmt::print("\nThe last one: {}\n", all.adjusted);
  return quantile(all.during_ms, 0.99) <= 100 && all.local_solves > 0 ? 0 : 1;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("Acknowledgement of keyframes during global bundle adjustment",
               "cairn_ingest_bench");
  cairn::bench::Arguments arguments;
  app.add_option("--clients", arguments.clients, "That stream keyframes")->capture_default_str();
  app.add_option("--rate", arguments.rate, "Keyframes a second of each")->capture_default_str();
  app.add_option("--rounds", arguments.rounds, "How often")->capture_default_str();
  app.add_option("--keyframes", arguments.keyframes, "Of the large map")->capture_default_str();
  app.add_option("--landmarks", arguments.landmarks, "Of the large map")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return cairn::bench::run(arguments);
}
