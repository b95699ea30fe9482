// Loops: are true ones found, and is any false one believed?
//
//   ./dev bench loops                rooms of equal posters and of equal bricks, 20 seeds of each
//   ./dev bench loops --pairs        pairs of keyframes in maps of known places
//   ./dev bench loops --pairs --csv FILE   all figures of each pair, with no demand made
//
// Each map is made by the real programs in lockstep. In the first mode they close loops as they
// would anywhere; then recognition and verification look at each keyframe once more, in this
// process, with everything in the map that came later too. Exit code 1: a false loop.
#include <cstdio>

#include <algorithm>
#include <fstream>

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <CLI/CLI.hpp>

#include "server/place/default_vocabulary.h"
#include "tests/bench/loops/judged_pairs.h"
#include "tests/support/temp_folder.h"

namespace cairn::bench {
namespace {

struct Arguments {
  int seeds = 20, frames = 200;
  bool pairs = false;
  std::string csv, keep;
  std::vector<std::string> only;
};

bool is_wanted(const Arguments& arguments, const std::string& name) {
  return arguments.only.empty() ||
         std::find(arguments.only.begin(), arguments.only.end(), name) != arguments.only.end();
}

int count(const std::string& text, const std::string& what) {
  int found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1))
    ++found;
  return found;
}

// --- Repeated textures

// The walls in front of two clients, from two sides of the room, more than once round in all.
Result<MapRun> repeats(const Arguments& arguments, const std::string& scene, int seed) {
  MapRun run{fmt::format("{}_{}", scene, seed), {}, true, arguments.keep};
  for (const int path : {0, 1}) {
    auto walk = synthetic_walk(
        fmt::format("{}?frames={}&seed={}&path={}&rate=15", scene, arguments.frames, seed, path));
    if (!walk) return walk.error();
    run.walks.push_back(std::move(*walk));
  }
  return run;
}

struct RepeatScore {
  int keyframes = 0, candidates = 0, near = 0, accepted = 0, wrong = 0;
  int server_candidates = 0, server_events = 0, wrong_events = 0;
  int seeds = 0, false_seeds = 0;

  void add(const KnownMap& known, const std::vector<JudgedPair>& pairs) {
    int wrong_here = 0;
    keyframes += static_cast<int>(known.world_from_camera.size());
    for (const JudgedPair& pair : pairs) {
      ++candidates;
      near += pair.is_near();
      accepted += pair.verification.loop.has_value();
      wrong_here += pair.is_wrong();
    }
    wrong += wrong_here;
    server_candidates += count(known.server_log, " may show what ");
    server_events += static_cast<int>(known.map.loops.size());
    wrong_events += cairn::bench::wrong_events(known);
    ++seeds;
    false_seeds += wrong_here > 0 || cairn::bench::wrong_events(known) > 0;
  }
};

void tell_wrong(const KnownMap& known, const std::vector<JudgedPair>& pairs) {
  for (const JudgedPair& p : pairs)
    if (p.is_wrong())
      fmt::print("wrong in {}: {}/{:x} as {}/{:x}, off by {:.2f} m and {:.2f} rad, {} inliers\n",
                 known.name, p.query.sequence, p.query.epoch, p.candidate.sequence,
                 p.candidate.epoch, p.off_m, p.off_rad, p.verification.loop->inliers);
}

int run_repeats(const Arguments& arguments) {
  const auto vocabulary = default_vocabulary();
  if (!vocabulary) return 2;
  int false_seeds = 0;
  std::string table;
  for (const char* scene : {"posters", "bricks"}) {
    if (!is_wanted(arguments, scene)) continue;
    RepeatScore score;
    for (int seed = 1; seed <= arguments.seeds; ++seed) {
      const auto run = repeats(arguments, scene, seed);
      const auto known = run ? make_known_map(*run) : Result<KnownMap>(run.error());
      if (!known) {
        fmt::print(stderr, "loops: {}\n", known.message());
        return 2;
      }
      const auto pairs = judge_candidates(*known, *vocabulary, {});
      tell_wrong(*known, pairs);
      score.add(*known, pairs);
      fmt::print(stderr, "{} seed {}: {} keyframes, {} candidates, {} wrong so far\n", scene, seed,
                 known->world_from_camera.size(), pairs.size(), score.wrong);
    }
    false_seeds += score.false_seeds;
    table += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", scene,
                         score.seeds, score.keyframes, score.server_candidates, score.server_events,
                         score.wrong_events, score.candidates, score.accepted, score.wrong,
                         score.false_seeds);
  }
  fmt::print(
      "\n| room | seeds | keyframes | candidates in the run | closed | wrong | candidates after | "
      "accepted | wrong | seeds with a false loop |\n|---|---|---|---|---|---|---|---|---|---|\n{}",
      table);
  return false_seeds > 0 ? 1 : 0;
}

// --- Pairs

// All that verification finds out, whatever it thinks of it.
VerifyOptions without_demands() {
  VerifyOptions options;
  options.min_inliers = options.min_consensus;
  options.min_cells = 0;
  options.max_contradicted = options.max_rival = options.max_rival_votes = 1e9;
  options.min_found = options.min_distinctive = 0;
  options.min_flat_extent_m = options.min_flat_extent = 0;
  return options;
}

void write_csv(std::ofstream& out, const std::string& name, const std::vector<JudgedPair>& pairs) {
  for (const JudgedPair& p : pairs) {
    const Verification& v = p.verification;
    fmt::print(out,
               "{},{},{},{},{},{:.3f},{:.3f},{},{:.4f},{:.4f},{},{},{},{},{},{:.4f},{:.4f},"
               "{:.4f},{:.4f},{:.3f}\n",
               name, p.query.epoch, p.query.sequence, p.candidate.epoch, p.candidate.sequence,
               p.distance_m, p.turn_rad, v.loop.has_value(), p.off_m, p.off_rad, v.matches,
               v.consensus, v.grown, v.cells_query, v.cells_candidate, v.contradicted, v.found,
               v.distinctive, v.rival, v.flat_extent);
  }
}

void tell_pairs(const std::string& name, const std::vector<JudgedPair>& pairs) {
  int near = 0, near_accepted = 0, accepted = 0, wrong = 0;
  double milliseconds = 0;
  for (const JudgedPair& p : pairs) {
    near += p.is_near();
    near_accepted += p.is_near() && p.verification.loop;
    accepted += p.verification.loop.has_value();
    wrong += p.is_wrong();
    milliseconds += p.milliseconds;
  }
  fmt::print("| {} | {} | {} | {} | {} | {} | {:.0f} |\n", name, pairs.size(), near, near_accepted,
             accepted, wrong, pairs.empty() ? 0 : milliseconds / static_cast<double>(pairs.size()));
}

Result<std::vector<MapRun>> known_places(const Arguments& arguments,
                                         const std::filesystem::path& folder) {
  std::vector<MapRun> runs;
  const auto add = [&](const std::string& name, std::vector<Result<WalkInput>> walks) -> Status {
    MapRun run{name, {}, false, arguments.keep};
    for (auto& walk : walks) {
      if (!walk && walk.error().code == ErrorCode::kNotFound) return {};  // not at hand
      if (!walk) return walk.error();
      run.walks.push_back(std::move(*walk));
    }
    runs.push_back(std::move(run));
    return {};
  };
  Status s = add("corridor", {synthetic_walk("corridor?frames=1250")});
  if (s)
    s = add("desk", {synthetic_walk("desk?frames=300"), synthetic_walk("desk?frames=300&path=1")});
  if (s)
    s = add("hall", {synthetic_walk("hall?frames=400"), synthetic_walk("hall?frames=400&path=1")});
  const std::string kitchen = "sevenscenes_kitchen_400", rpy = "tum_fr1_rpy_240";
  if (s)
    s = add("kitchen",
            {recorded_walk(kitchen, "client_7scenes.yaml", 0, 200, folder / "kitchen1"),
             recorded_walk(kitchen, "client_7scenes.yaml", 200, 400, folder / "kitchen2")});
  if (s)
    s = add("rpy", {recorded_walk(rpy, "client_tum_fr1.yaml", 0, 120, folder / "rpy1"),
                    recorded_walk(rpy, "client_tum_fr1.yaml", 120, 240, folder / "rpy2")});
  for (const char* scene : {"posters", "bricks"})
    if (s)
      s = add(fmt::format("{} apart", scene),
              {synthetic_walk(fmt::format("{}?frames=300&rate=15", scene)),
               synthetic_walk(fmt::format("{}?frames=300&rate=15&path=1", scene))});
  if (!s) return s.error();
  return runs;
}

// Of keyframes that are not near to each other, from each map.
constexpr std::size_t kMostPairs = 300;

int run_pairs(const Arguments& arguments) {
  const synthetic::TempFolder folder;
  const auto runs = known_places(arguments, folder.path());
  if (!runs) {
    fmt::print(stderr, "loops: {}\n", runs.message());
    return 2;
  }
  std::ofstream csv(arguments.csv);
  fmt::print(
      "| map | pairs | near | of these accepted | accepted | wrong | ms |\n"
      "|---|---|---|---|---|---|---|\n");
  int wrong = 0;
  const auto tell = [&](const std::string& name, const std::vector<JudgedPair>& pairs) {
    tell_pairs(name, pairs);
    for (const JudgedPair& p : pairs) wrong += p.is_wrong();
  };
  std::optional<KnownMap> all;
  for (const MapRun& run : *runs) {
    if (!is_wanted(arguments, run.name)) continue;
    const auto known = make_known_map(run);
    if (!known) {
      fmt::print(stderr, "loops: {}\n", known.message());
      return 2;
    }
    const auto chosen = some_pairs(*known, kMostPairs);
    if (csv.is_open()) {
      write_csv(csv, run.name, judge_all(*known, chosen, without_demands()));
      continue;
    }
    const auto pairs = judge_all(*known, chosen, {});
    tell_wrong(*known, pairs);
    tell(run.name, pairs);
    if (all) {
      const KnownMap both = side_by_side(*all, *known);
      const auto strangers = some_pairs(both, kMostPairs, [&](KeyframeId q, KeyframeId c) {
        return known->map.keyframes.contains(q) != known->map.keyframes.contains(c);
      });
      tell("strangers to " + run.name, judge_all(both, strangers, {}));
    }
    all = all ? side_by_side(*all, *known) : *known;
  }
  return wrong > 0 ? 1 : 0;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("Loops: true ones found, false ones refused", "cairn_loops_bench");
  cairn::bench::Arguments arguments;
  app.add_option("--seeds", arguments.seeds, "Of each room with repeated textures")
      ->capture_default_str();
  app.add_option("--frames", arguments.frames, "Of each walk there, at 15 Hz")
      ->capture_default_str();
  app.add_flag("--pairs", arguments.pairs, "Pairs of keyframes in maps of known places");
  app.add_option("--csv", arguments.csv, "Write the figures of every pair to this file");
  app.add_option("--only", arguments.only, "The rooms, or with --pairs the maps, of these names");
  app.add_option("--keep", arguments.keep, "Keep map files in this folder, and use them again");
  CLI11_PARSE(app, argc, argv);
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return arguments.pairs ? cairn::bench::run_pairs(arguments)
                         : cairn::bench::run_repeats(arguments);
}
