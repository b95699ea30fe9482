#include "server/tool/eval_command.h"

#include <cmath>
#include <memory>
#include <string>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "server/tool/evaluation.h"

namespace cairn {
namespace {

struct Arguments {
  std::string truth, estimate;
  bool sim3 = false, json = false;
  EvaluationOptions options;
};

constexpr double kDegrees = 180.0 / M_PI;

std::string row(const char* name, const ErrorStatistics& e, double factor, const char* unit) {
  return fmt::format("{:<18} {:>9.4f} {:>9.4f} {:>9.4f} {:>9.4f}  {}\n", name, e.rmse * factor,
                     e.mean * factor, e.median * factor, e.max * factor, unit);
}

std::string as_text(const Evaluation& result, const EvaluationOptions& options) {
  std::string out =
      fmt::format("{:<18} {:>9} {:>9} {:>9} {:>9}\n", "", "RMSE", "mean", "median", "max");
  out += row(options.with_scale ? "ATE (Sim3)" : "ATE (SE3)", result.ate, 1, "m");
  const std::string delta = fmt::format("{:g} s", options.rpe_delta_s);
  out += row("RPE translation", result.rpe_translation, 1, ("m over " + delta).c_str());
  out += row("RPE rotation", result.rpe_rotation, kDegrees, ("degrees over " + delta).c_str());
  out += fmt::format("pairs              {}\n", result.pairs);
  out += fmt::format("coverage           {:.1f} %\n", 100 * result.coverage);
  out += fmt::format("scale              {:.5f}\n", result.scale);
  return out;
}

nlohmann::json as_json(const ErrorStatistics& e) {
  return {{"rmse", e.rmse}, {"mean", e.mean}, {"median", e.median},
          {"min", e.min},   {"max", e.max},   {"count", e.count}};
}

nlohmann::json as_json(const Evaluation& result, const EvaluationOptions& options) {
  return {{"alignment", options.with_scale ? "sim3" : "se3"},
          {"ate_m", as_json(result.ate)},
          {"rpe_delta_s", options.rpe_delta_s},
          {"rpe_translation_m", as_json(result.rpe_translation)},
          {"rpe_rotation_rad", as_json(result.rpe_rotation)},
          {"pairs", result.pairs},
          {"coverage", result.coverage},
          {"scale", result.scale}};
}

int run_eval(const Arguments& arguments) {
  const auto truth = read_trajectory(arguments.truth);
  if (!truth) return fail(truth.message());
  const auto estimate = read_trajectory(arguments.estimate);
  if (!estimate) return fail(estimate.message());
  EvaluationOptions options = arguments.options;
  options.with_scale = arguments.sim3;
  const auto result = evaluate(*truth, *estimate, options);
  if (!result) return fail(arguments.estimate + ": " + result.message());
  std::cout << (arguments.json ? as_json(*result, options).dump(2) + "\n"
                               : as_text(*result, options));
  return kExitOk;
}

}  // namespace

void add_eval_command(CLI::App& app, std::function<int()>& run) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("eval", "Compare a trajectory with the true one");
  command->add_option("groundtruth", arguments->truth, "TUM, EuRoC or KITTI file")->required();
  command->add_option("estimate", arguments->estimate, "TUM, EuRoC or KITTI file")->required();
  command->add_flag("--sim3", arguments->sim3, "Align with scale too (monocular)");
  command->add_flag("--json", arguments->json, "Print JSON");
  command
      ->add_option("--max-diff", arguments->options.max_diff_s,
                   "Greatest difference in seconds of stamps that belong together")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--rpe-delta", arguments->options.rpe_delta_s,
                   "Seconds over which the relative error is measured")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--frames", arguments->options.frames,
                      "Frames that the recording has: coverage is judged by these");
  command->callback([arguments, &run] { run = [arguments] { return run_eval(*arguments); }; });
}

}  // namespace cairn
