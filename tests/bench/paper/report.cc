#include "tests/bench/paper/report.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <limits>
#include <thread>

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include "common/util/clock.h"
#include "tests/bench/paper/svg.h"

namespace cairn::bench {
namespace {

// Which of the methods, and of the variants, is judged: sharpening as it is by default.
constexpr std::size_t kSharpened = 3, kOn = 1;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  return "unknown processor";
}

std::string today() {
  const std::time_t now = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d", std::gmtime(&now));
  return text;
}

using PairValue = std::function<double(const PairMatches&)>;
double median_of(const MatchingResult& result, const PairValue& value) {
  std::vector<double> values;
  for (const PairMatches& pair : result.pairs) values.push_back(value(pair));
  return median(values);
}
double inliers(const PairMatches& p) {
  return p.inliers;
}

// Mean change against the first of a pair, as a share of the first's mean, and its standard error.
struct PairedChange {
  double change = kNone, error = kNone;
};
PairedChange paired_change(const std::vector<double>& before, const std::vector<double>& after) {
  const auto n = static_cast<double>(before.size());
  double sum = 0, differences = 0, squares = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const double d = after[i] - before[i];
    sum += before[i];
    differences += d;
    squares += d * d;
  }
  if (before.size() < 2 || !(sum > 0)) return {};
  const double mean = differences / n;
  const double variance = (squares - n * mean * mean) / (n - 1);
  return {differences / sum, std::sqrt(std::max(0.0, variance) / n) * n / sum};
}
std::string to_text(const PairedChange& c) {
  return std::isfinite(c.change) ? fmt::format("{:+.1f} ± {:.1f} %", 100 * c.change, 100 * c.error)
                                 : "";
}

std::vector<double> inliers_of(const MatchingResult& result) {
  std::vector<double> values;
  for (const PairMatches& pair : result.pairs) values.push_back(pair.inliers);
  return values;
}
double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

using RunValue = std::function<double(const RunResult&)>;
std::vector<double> values_of(const std::vector<RunResult>& runs, const RunValue& value) {
  std::vector<double> values;
  for (const RunResult& run : runs)
    if (run.succeeded) values.push_back(value(run));
  return values;
}
// Runs that fail count as worse than any other.
double median_of(const std::vector<RunResult>& runs, const RunValue& value) {
  std::vector<double> values = values_of(runs, value);
  values.resize(runs.size(), std::numeric_limits<double>::infinity());
  const double middle = median(values);
  return std::isfinite(middle) ? middle : kNone;
}
double ate(const RunResult& r) {
  return r.errors.ate.rmse;
}
double rpe(const RunResult& r) {
  return r.errors.rpe_translation.rmse;
}
double tracking(const RunResult& r) {
  return r.tracking_ms;
}

double mean_coverage(const std::vector<RunResult>& runs) {
  double sum = 0;
  for (const RunResult& run : runs) sum += run.coverage();
  return sum / static_cast<double>(runs.size());
}

// In how many runs the second is nearer the truth than the first; failing is worst.
std::string wins(const std::vector<RunResult>& before, const std::vector<RunResult>& after) {
  int better = 0;
  for (std::size_t i = 0; i < before.size(); ++i)
    better += after[i].succeeded && (!before[i].succeeded || ate(after[i]) < ate(before[i]));
  return fmt::format("{} of {}", better, before.size());
}

std::string number(double value, int decimals) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, decimals) : "fails";
}
std::string change(double before, double after) {
  return std::isfinite(before) && std::isfinite(after) && before > 0
             ? fmt::format("{:+.0f} %", 100 * (after / before - 1))
             : "";
}
// "0.0123 (0.0110-0.0150)"
std::string with_range(const std::vector<RunResult>& runs, const RunValue& value, int decimals) {
  const std::vector<double> all = values_of(runs, value);
  if (all.empty()) return "fails";
  const auto [low, high] = std::minmax_element(all.begin(), all.end());
  return fmt::format("{} ({:.{}f}-{:.{}f})", number(median_of(runs, value), decimals), *low,
                     decimals, *high, decimals);
}

// The pair that gains what most gain: that of the median gain from the first to the last method.
std::size_t typical_pair(const MatchingTable& table) {
  std::vector<std::pair<int, std::size_t>> gains;
  for (std::size_t i = 0; i < table.set->pairs.size(); ++i)
    gains.emplace_back(
        table.results[kSharpened].pairs[i].inliers - table.results[0].pairs[i].inliers, i);
  const auto middle = gains.begin() + static_cast<std::ptrdiff_t>(gains.size() / 2);
  std::nth_element(gains.begin(), middle, gains.end());
  return middle->second;
}

// The run whose ATE is the median's neighbour, of those that succeeded.
const RunResult* typical_run(const std::vector<RunResult>& runs) {
  const double middle = median(values_of(runs, ate));
  const RunResult* best = nullptr;
  for (const RunResult& run : runs)
    if (run.succeeded && (!best || std::abs(ate(run) - middle) < std::abs(ate(*best) - middle)))
      best = &run;
  return best;
}

LineChart trajectory_chart(const RunTable& table, std::size_t run) {
  LineChart chart{table.set.title + fmt::format(", run {}", run + 1), "x, m", "y, m", {}, true};
  Line truth{"ground truth", {}};
  const Trajectory& all = table.truths[run];
  std::int64_t first = all.front().stamp_ns, last = all.back().stamp_ns;
  for (const auto& of_variant : table.runs)
    if (of_variant[run].succeeded) {
      first = of_variant[run].estimate.front().stamp_ns;
      last = of_variant[run].estimate.back().stamp_ns;
    }
  for (const StampedPose& p : all)
    if (p.stamp_ns >= first && p.stamp_ns <= last)
      truth.points.push_back({p.world_from_camera.origin().x(), p.world_from_camera.origin().y()});
  chart.lines.push_back(truth);
  for (std::size_t v = 0; v < table.variants.size(); ++v) {
    Line line{table.variants[v].name, {}};
    const RunResult& result = table.runs[v][run];
    for (const StampedPose& p : result.estimate) {
      const Eigen::Vector3d at = result.errors.truth_from_estimate * p.world_from_camera.origin();
      line.points.push_back({at.x(), at.y()});
    }
    chart.lines.push_back(line);
  }
  return chart;
}

BarChart bar_chart(const std::vector<RunTable>& tables, const std::string& title,
                   const std::string& label, const RunValue& value) {
  BarChart chart{title, label, {}, {}};
  for (std::size_t v = 0; v < tables[0].variants.size(); ++v)
    chart.bars.push_back({tables[0].variants[v].name, {}});
  for (const RunTable& table : tables) {
    chart.groups.push_back(table.set.name);
    for (std::size_t v = 0; v < table.variants.size(); ++v)
      chart.bars[v].values.push_back(median_of(table.runs[v], value));
  }
  return chart;
}

}  // namespace

double median(std::vector<double> values) {
  if (values.empty()) return kNone;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

Report::Report(const std::filesystem::path& folder) : folder_(folder) {
  std::filesystem::create_directories(folder);
  page_.open(folder / "README.md");
}

void Report::picture(const std::string& name, const std::string& svg) {
  std::ofstream(folder_ / (name + ".svg")) << svg;
  page_ << fmt::format("![{0}]({0}.svg)\n\n", name);
}

void Report::picture(const std::string& name, const cv::Mat& image) {
  cv::imwrite((folder_ / (name + ".jpg")).string(), image, {cv::IMWRITE_JPEG_QUALITY, 80});
  page_ << fmt::format("![{0}]({0}.jpg)\n\n", name);
}

void Report::introduce(int runs, bool quick) {
  page_ << "# The experiments of Luo et al. 2020, repeated\n\n"
           "*Improved ORB-SLAM2 Algorithm Based on Information Entropy and Image Sharpening "
           "Adjustment*, doi 10.1155/2020/4724310. Made by `./dev bench paper`"
        << (quick ? " --quick" : "")
        << fmt::format("; {} runs of each kind.\n{}, {} processors; {}. Cairn {}.\n\n", runs,
                       processor(), std::thread::hardware_concurrency(), today(), CAIRN_VERSION);
}

void Report::add_rotated_pairs(const std::vector<MatchingTable>& tables) {
  page_ << "## Matches of rotated, blurred pairs (the paper's table 1)\n\n"
           "Medians over the pairs, but for the mean. Matches: mutual nearest neighbours. RANSAC: "
           "fundamental matrix, 2 pixels; change: of the mean against plain ORB, pair by pair, "
           "with its standard error. Correct: matches after RANSAC that ground truth confirms. "
           "Best corners first: corners chosen as with sharpening, fainter ones too where they "
           "lack, but nothing sharpened. The paper has 87 matches after RANSAC with plain ORB, 133 "
           "with entropy and sharpening "
           "(+53 %).\n\n"
           "| views | pairs | method | key points | matches | after RANSAC | mean | change | rate "
           "| correct | | extraction ms |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  for (const MatchingTable& table : tables)
    for (std::size_t m = 0; m < table.methods.size(); ++m) {
      const auto med = [&](const PairValue& v) { return median_of(table.results[m], v); };
      const auto first = [&](const PairValue& v) { return median_of(table.results[0], v); };
      const auto correct = [](const PairMatches& p) { return static_cast<double>(p.correct); };
      page_ << fmt::format(
          "| {} | {} | {} | {:.0f} | {:.0f} | {:.0f} | {:.1f} | {} | {:.2f} | {:.0f} | {} | {:.1f} "
          "|\n",
          m == 0 ? table.set->title : "", table.set->pairs.size(), table.methods[m].name,
          med([](const PairMatches& p) { return p.key_points; }),
          med([](const PairMatches& p) { return p.matches; }), med(inliers),
          mean(inliers_of(table.results[m])),
          m == 0
              ? ""
              : to_text(paired_change(inliers_of(table.results[0]), inliers_of(table.results[m]))),
          med([](const PairMatches& p) { return p.rate(); }), med(correct),
          m == 0 ? "" : change(first(correct), med(correct)),
          median(table.results[m].extraction_ms));
    }
  page_ << "\nOne pair of each, the one with the median gain:\n\n";
  for (const MatchingTable& table : tables)
    if (!table.set->pairs.empty())
      picture("matches_" + table.set->name,
              draw_pair(*table.set, typical_pair(table),
                        {table.methods[0], table.methods[kSharpened]}));
}

void Report::add_adjacent_frames(const std::vector<MatchingTable>& tables) {
  page_ << "## Matches of adjacent frames (the paper's figure 12)\n\n"
           "After RANSAC. In the embedded scene the camera turns ever faster, from rest to 2.5 "
           "rad/s, so that a point is smeared over up to 26 pixels.\n\n"
           "| views | frames | method | median, all | slower half | faster half |\n"
           "|---|---|---|---|---|---|\n";
  for (const MatchingTable& table : tables) {
    std::vector<double> rates;
    for (const auto& [i, j] : table.set->pairs) rates.push_back(table.set->views[j].turn_rate);
    const double middle = median(rates);
    for (std::size_t m = 0; m < table.methods.size(); ++m) {
      std::vector<double> slow, fast;
      for (std::size_t i = 0; i < rates.size(); ++i)
        (rates[i] < middle ? slow : fast).push_back(table.results[m].pairs[i].inliers);
      page_ << fmt::format("| {} | {} | {} | {:.0f} | {:.0f} | {:.0f} |\n",
                           m == 0 ? table.set->title : "", table.set->views.size(),
                           table.methods[m].name, median_of(table.results[m], inliers),
                           median(slow), median(fast));
    }
  }
  page_ << '\n';
  for (const MatchingTable& table : tables) {
    LineChart chart{"Matches of adjacent frames after RANSAC: " + table.set->title,
                    "frame",
                    "matches",
                    {},
                    false};
    for (std::size_t m = 0; m < table.methods.size(); ++m) {
      Line line{table.methods[m].name, {}};
      for (std::size_t i = 0; i < table.results[m].pairs.size(); ++i)
        line.points.push_back({static_cast<double>(table.set->pairs[i].second),
                               static_cast<double>(table.results[m].pairs[i].inliers)});
      chart.lines.push_back(line);
    }
    picture("adjacent_" + table.set->name, draw(chart));
  }
}

void Report::add_runs(const std::vector<RunTable>& tables) {
  page_
      << "## Trajectories and time (the paper's tables 2 to 4, figures 13 to 17)\n\n"
         "A server and a client over loopback; medians of the runs and, in brackets, their "
         "range. The runs of an embedded scene have seeds of their own (other textures, noise "
         "and shake of the hand) and can be repeated exactly (--lockstep); those of a recording "
         "go at full rate, where chance decides which corrections are in when a frame comes. "
         "ATE: RMSE in metres after alignment in SE(3); RPE: metres over a second. A run fails "
         "when less than half of its frames are tracked. The paper has ATE -45 %, RPE -36 %, "
         "tracking time +18 to +28 %. Sharpening `on` is the default of cairn-client; `paper` is "
         "sharpening as published (as_in_paper). Times depend on what else "
         "the machine does: compare them within a data set.\n\n"
         "| data set | sharpening | runs tracked | frames tracked | ATE m | | runs better | RPE m "
         "| | "
         "tracking ms | | features ms |\n|---|---|---|---|---|---|---|---|---|---|---|---|\n";
  std::ofstream csv(folder_ / "runs.csv");
  csv << "data_set,sharpening,run,succeeded,frames,tracked,keyframes,ate_m,rpe_m,tracking_ms,"
         "extraction_ms\n";
  for (const RunTable& table : tables)
    for (std::size_t v = 0; v < table.variants.size(); ++v) {
      const auto& runs = table.runs[v];
      const auto against_first = [&](const RunValue& value) {
        return v == 0 ? std::string()
                      : change(median_of(table.runs[0], value), median_of(runs, value));
      };
      page_ << fmt::format(
          "| {} | {} | {} of {} | {:.0f} % | {} | {} | {} | {} | {} | {} | {} | {} |\n",
          v == 0 ? table.set.title : "", table.variants[v].name, values_of(runs, ate).size(),
          runs.size(), 100 * mean_coverage(runs), with_range(runs, ate, 4), against_first(ate),
          v == 0 ? "" : wins(table.runs[0], runs), with_range(runs, rpe, 4), against_first(rpe),
          number(median_of(runs, tracking), 1), against_first(tracking),
          number(median_of(runs, [](const RunResult& r) { return r.extraction_ms; }), 1));
      for (std::size_t i = 0; i < runs.size(); ++i)
        csv << fmt::format("{},{},{},{},{},{},{},{:.5f},{:.5f},{:.2f},{:.2f}\n", table.set.name,
                           table.variants[v].name, i + 1, runs[i].succeeded ? 1 : 0, runs[i].frames,
                           runs[i].tracked, runs[i].keyframes, ate(runs[i]), rpe(runs[i]),
                           runs[i].tracking_ms, runs[i].extraction_ms);
    }
  page_ << "\nEvery run: [runs.csv](runs.csv).\n\n";
  picture("ate", draw(bar_chart(tables, "ATE, median of the runs", "m", ate)));
  picture("rpe", draw(bar_chart(tables, "RPE, median of the runs", "m over 1 s", rpe)));
  picture("tracking",
          draw(bar_chart(tables, "Tracking, features included", "ms a frame", tracking)));
  for (const RunTable& table : tables)
    if (const RunResult* run = typical_run(table.runs[kOn]))
      picture(
          "trajectory_" + table.set.name,
          draw(trajectory_chart(table, static_cast<std::size_t>(run - table.runs[kOn].data()))));
}

bool Report::add_verdict(const std::vector<MatchingTable>& pairs,
                         const std::vector<RunTable>& runs) {
  page_ << "## What is asked of sharpening\n\n";
  bool all = true;
  const auto check = [&](bool holds, const std::string& what) {
    all = all && holds;
    page_ << fmt::format("- {}: {}\n", holds ? "holds" : "**does not hold**", what);
  };
  for (const MatchingTable& table : pairs) {
    const std::vector<double> before = inliers_of(table.results.front());
    const std::vector<double> after = inliers_of(table.results[kSharpened]);
    check(mean(after) > mean(before),
          fmt::format("matches after RANSAC rise on {}: {:.1f} to {:.1f} on average ({}), median "
                      "{:.0f} to {:.0f}",
                      table.set->title, mean(before), mean(after),
                      to_text(paired_change(before, after)), median(before), median(after)));
  }
  double log_sum = 0;
  int hard = 0;
  for (const RunTable& table : runs) {
    const double before = median_of(table.runs.front(), ate);
    const double after = median_of(table.runs[kOn], ate);
    if (table.set.role == Role::kTextureless) {
      check(std::isfinite(after),
            fmt::format("{} is tracked: {:.0f} % of the frames, {:.0f} % without", table.set.title,
                        100 * mean_coverage(table.runs[kOn]), 100 * mean_coverage(table.runs[0])));
      continue;
    }
    check(after <= 1.05 * before,
          fmt::format("{} is not made worse by more than 5 %: ATE {} to {} m", table.set.title,
                      number(before, 4), number(after, 4)));
    if (table.set.role != Role::kHard || !std::isfinite(before) || !std::isfinite(after)) continue;
    log_sum += std::log(after / before);
    ++hard;
  }
  if (hard > 0)
    check(log_sum < 0, fmt::format("ATE over the {} blurred or weakly textured sets falls: {:+.1f} "
                                   "% (geometric mean of the medians' ratios)",
                                   hard, 100 * (std::exp(log_sum / hard) - 1)));
  page_ << '\n';
  return all;
}

}  // namespace cairn::bench
