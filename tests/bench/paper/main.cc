// ./dev bench paper: the experiments of Luo et al. 2020 (doi 10.1155/2020/4724310) with Cairn.
#include <algorithm>
#include <deque>
#include <future>
#include <iostream>
#include <sstream>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "tests/bench/paper/report.h"

namespace cairn::bench {
namespace {

struct Arguments {
  std::string data, out = "build/bench/paper";
  std::vector<std::string> only, variants;
  int runs = 6;
  bool quick = false, no_matching = false, no_runs = false, strict = false, parallel = false;
};

void say(const std::string& line) {
  std::cerr << line << std::endl;
}

// Table 1's rows, and one for each further variant.
Result<std::vector<Method>> rows_of(const std::vector<Variant>& variants) {
  std::vector<ExtractorOptions> options;
  for (const Variant& variant : variants) {
    const auto config = client_config(variant);
    if (!config) return config.error();
    options.push_back(config->frontend.extractor);
  }
  std::vector<Method> all = methods(options[0], options[1]);
  for (std::size_t i = 2; i < variants.size(); ++i)
    all.push_back({fmt::format("the same, `{}`", variants[i].name), options[i]});
  return all;
}

MatchingTable match(const ViewSet& set, const std::vector<Method>& all) {
  MatchingTable table{&set, all, {}};
  for (const Method& method : table.methods) table.results.push_back(match_views(set, method));
  say(fmt::format("matched {}: {} pairs", set.title, set.pairs.size()));
  return table;
}

// Views of what there is. Deque: tables point into it.
struct AllViews {
  std::deque<ViewSet> rotated, adjacent;
};
Status make_views(const std::vector<DataSet>& sets, bool quick, AllViews& views) {
  for (const char* scene : {"desk", "weak", "bare"}) {
    auto set = rotated_pairs(scene, quick ? 20 : 60);
    if (!set) return set.error();
    views.rotated.push_back(*set);
  }
  for (const char* scene : {"desk", "weak"}) {
    auto set = sharp_to_blurred(scene, quick ? 15 : 40);
    if (!set) return set.error();
    views.adjacent.push_back(*set);
  }
  for (const DataSet& data : sets) {
    if (data.name != "fr1_rpy" && data.name != "fr1_360") continue;
    auto set = adjacent_frames(data.folder, data.title);
    if (!set) return set.error();
    views.rotated.push_back(rotated_pairs(*set, quick ? 30 : 300));
    views.adjacent.push_back(*set);
  }
  return {};
}

// Without sharpening, as by default, as in the paper; more: "name={block: 16}".
Result<std::vector<Variant>> variants(const std::vector<std::string>& more) {
  std::vector<Variant> all = {
      {"off", "{mode: off}"}, {"on", std::nullopt}, {"paper", "{as_in_paper: true}"}};
  for (const std::string& text : more) {
    const auto equals = text.find('=');
    if (equals == std::string::npos)
      return {ErrorCode::kInvalidArgument, "--variant takes NAME={YAML}, not '" + text + "'"};
    all.push_back({text.substr(0, equals), text.substr(equals + 1)});
  }
  return all;
}

// One run of each variant. In lockstep they may go side by side: the results are the same.
std::vector<Result<RunResult>> run_variants(const DataSet& set, const RunInput& input,
                                            const std::vector<Variant>& all, bool parallel) {
  const auto policy = parallel && !set.synth.empty() ? std::launch::async : std::launch::deferred;
  std::vector<std::future<Result<RunResult>>> started;
  for (const Variant& variant : all)
    started.push_back(std::async(policy, [&] { return run_client(set, input, variant); }));
  std::vector<Result<RunResult>> results;
  for (auto& one : started) results.push_back(one.get());
  return results;
}

Result<RunTable> run_all(const DataSet& set, const std::vector<Variant>& all,
                         const Arguments& arguments) {
  RunTable table{set, all, std::vector<std::vector<RunResult>>(all.size()), {}};
  for (int run = 1; run <= arguments.runs; ++run) {
    const auto input = run_input(set, run);
    if (!input) return input.error();
    table.truths.push_back(input->truth);
    const auto results = run_variants(set, *input, all, arguments.parallel);
    for (std::size_t v = 0; v < all.size(); ++v) {
      const auto& result = results[v];
      if (!result) return result.error();
      say(fmt::format("{:<12} run {} {:<8} {:>3} of {} frames, ATE {:.4f} m, tracking {:.1f} ms",
                      set.name, run, all[v].name, result->tracked, result->frames,
                      result->errors.ate.rmse, result->tracking_ms));
      table.runs[v].push_back(*result);
    }
  }
  return table;
}

Status experiments(const Arguments& arguments, bool& holds) {
  std::optional<std::filesystem::path> data;
  if (!arguments.data.empty()) data = arguments.data;
  const auto sets = data_sets(data, arguments.quick);
  const auto all = variants(arguments.variants);
  if (!all) return all.error();
  Report report(arguments.out);
  report.introduce(arguments.runs, arguments.quick);

  AllViews views;
  std::vector<MatchingTable> rotated, adjacent;
  if (!arguments.no_matching) {
    if (Status s = make_views(sets, arguments.quick, views); !s) return s;
    const auto rows = rows_of(*all);
    if (!rows) return rows.error();
    for (const ViewSet& set : views.rotated) rotated.push_back(match(set, *rows));
    for (const ViewSet& set : views.adjacent) adjacent.push_back(match(set, *rows));
  }
  std::vector<RunTable> runs;
  for (const DataSet& set : sets) {
    const auto& only = arguments.only;
    if (arguments.no_runs) break;
    if (!only.empty() && std::find(only.begin(), only.end(), set.name) == only.end()) continue;
    auto table = run_all(set, *all, arguments);
    if (!table) return table.error();
    runs.push_back(std::move(*table));
  }
  holds = report.add_verdict(rotated, runs);
  if (!rotated.empty()) report.add_rotated_pairs(rotated);
  if (!adjacent.empty()) report.add_adjacent_frames(adjacent);
  if (!runs.empty()) report.add_runs(runs);
  return {};
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  cairn::bench::Arguments arguments;
  CLI::App app{"Repeats the experiments of Luo et al. 2020 and writes a page with pictures."};
  app.add_option("--data", arguments.data,
                 "Folder with TUM RGB-D sequences: freiburg1 desk, 360, room are used")
      ->check(CLI::ExistingDirectory);
  app.add_option("--out", arguments.out, "Folder for the page and its pictures")
      ->capture_default_str();
  app.add_option("--runs", arguments.runs, "Runs of each kind")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--only", arguments.only, "Runs on these data sets only, such as weak fr1_rpy");
  app.add_option("--variant", arguments.variants,
                 "Further settings of sharpening to run: NAME={YAML of the config's "
                 "frontend.sharpen}, such as 'small={block: 16}'");
  app.add_flag("--quick", arguments.quick, "Fewer pairs and shorter runs");
  app.add_flag("--no-matching", arguments.no_matching, "Without table 1 and figure 12");
  app.add_flag("--no-runs", arguments.no_runs, "Without tables 2 to 4");
  app.add_flag("--parallel", arguments.parallel,
               "Variants side by side on embedded scenes: sooner done, the times mean less");
  app.add_flag("--strict", arguments.strict, "Exit with 1 when something asked does not hold");
  CLI11_PARSE(app, argc, argv);
  bool holds = false;
  const cairn::Status status = cairn::bench::experiments(arguments, holds);
  if (!status) {
    std::cerr << "paper: " << status.message() << '\n';
    return 1;
  }
  std::cout << arguments.out << "/README.md\n";
  return holds || !arguments.strict ? 0 : 1;
}
