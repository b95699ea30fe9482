// cairn-server: the command line of the map server.
#include <pthread.h>

#include <csignal>
#include <cstdio>
#include <optional>
#include <string>

#include <CLI/CLI.hpp>

#include "common/util/log.h"
#include "server/pipeline.h"

namespace {

enum ExitCode { kSaved = 0, kFailed = 1, kBadUsage = 2 };

int complain(const cairn::Error& error) {
  fmt::print(stderr, "cairn-server: {}\n", error.message);
  return error.code == cairn::ErrorCode::kInvalidArgument ? kBadUsage : kFailed;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Builds one map from the keyframes of many clients; runs until SIGTERM or SIGINT."};
  app.set_version_flag("--version", CAIRN_VERSION);
  std::string config_path, log_level;
  std::optional<std::uint32_t> domain;
  std::optional<std::string> map_file, http;
  app.add_option("--config", config_path, "YAML file; every key has a default");
  app.add_option("--domain", domain, "DDS domain, 0 to 232; overrides the config")
      ->check(CLI::Range(0, 232));
  app.add_option("--map", map_file, "file of the map; made when missing, continued when there");
  app.add_option("--http", http, "ADDR:PORT of /status, /metrics and /healthz");
  app.add_option("--log-level", log_level, "debug, info, warn, error or off; overrides the config")
      ->check([](const std::string& level) {
        const cairn::Status known = cairn::log::check_level(level);
        return known ? std::string() : known.message();
      });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? kSaved : kBadUsage;
  }

  cairn::log::initialise("cairn-server", log_level.empty() ? "info" : log_level);
  cairn::ServerConfig config;
  if (!config_path.empty()) {
    cairn::Result<cairn::ServerConfig> loaded = cairn::load_server_config(config_path);
    if (!loaded) {
      fmt::print(stderr, "cairn-server: {}\n", loaded.message());
      return kBadUsage;
    }
    config = *loaded;
  }
  if (domain) config.domain = *domain;
  if (map_file) config.map_file = *map_file;
  if (http) config.http = *http;
  if (log_level.empty()) cairn::log::initialise("cairn-server", config.log_level);

  // Blocked before any thread starts, so that all inherit it and the signal waits for us here.
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  sigaddset(&ends, SIGINT);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);

  cairn::Result<std::unique_ptr<cairn::Pipeline>> pipeline = cairn::Pipeline::start(config);
  if (!pipeline) return complain(pipeline.error());
  int signal = 0;
  sigwait(&ends, &signal);
  cairn::log::info("{} received: finishing what is queued",
                   signal == SIGINT ? "SIGINT" : "SIGTERM");
  if (cairn::Status stopped = (*pipeline)->stop(); !stopped) return complain(stopped.error());
  return kSaved;
}
