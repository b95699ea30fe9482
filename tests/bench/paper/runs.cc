#include "tests/bench/paper/runs.h"

#include <cmath>
#include <csignal>
#include <sstream>

#include <yaml-cpp/yaml.h>

#include "tests/integration/process.h"

namespace cairn::bench {
namespace {

using std::chrono::seconds;

Result<std::string> config_text(const std::filesystem::path& base, const Variant& variant) {
  try {
    YAML::Node config = YAML::LoadFile(base.string());
    if (variant.sharpen) config["frontend"]["sharpen"] = YAML::Load(*variant.sharpen);
    std::ostringstream text;
    text << config << '\n';
    return text.str();
  } catch (const YAML::Exception& e) {
    return {ErrorCode::kInvalidArgument, "variant " + variant.name + ": " + e.what()};
  }
}

int count(const testing::Process& client, const char* name) {
  const double value = client.reported(name);
  return std::isnan(value) ? 0 : static_cast<int>(value);
}

}  // namespace

Result<ClientConfig> client_config(const Variant& variant) {
  const auto text = config_text(base_config(), variant);
  if (!text) return text.error();
  const testing::Deployment folder;
  return load_client_config(folder.write("config.yaml", *text));
}

Result<RunResult> run_client(const DataSet& set, const RunInput& input, const Variant& variant) {
  const auto config = config_text(input.config, variant);
  if (!config) return config.error();
  testing::Deployment deployment;
  const auto server = deployment.server();
  if (!server->wait_for_log("ready: ", seconds(20)))
    return {ErrorCode::kUnavailable, "cairn-server does not start: " + server->err()};
  const std::string trajectory = deployment.file("estimate.tum").string();
  const auto client = deployment.client(
      "paper", input.source,
      {set.synth.empty() ? "--max-rate" : "--lockstep", "--trajectory", trajectory},
      deployment.write("config.yaml", *config));
  const auto code = client->wait(seconds(900));
  server->signal(SIGTERM);
  server->wait(seconds(60));
  if (!code || *code == 2) return {ErrorCode::kUnavailable, "cairn-client fails: " + client->err()};

  RunResult result;
  result.frames = count(*client, "frames");
  result.tracked = count(*client, "tracked");
  result.keyframes = count(*client, "keyframes");
  result.tracking_ms = client->reported("tracking_ms_median");
  result.extraction_ms = client->reported("extraction_ms_median");
  if (*code != 0 || 2 * result.tracked < result.frames) return result;
  const auto estimate = read_trajectory(trajectory);
  if (!estimate) return result;
  const auto errors = evaluate(input.truth, *estimate);
  if (!errors) return result;
  result.succeeded = true;
  result.errors = *errors;
  result.estimate = *estimate;
  return result;
}

}  // namespace cairn::bench
