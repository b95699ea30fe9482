#include "tests/bench/swarm/bench_server.h"

#include <csignal>
#include <cstdlib>

#include <httplib.h>
#include <nlohmann/json.hpp>

#include "server/storage/map_file.h"

namespace cairn::bench {

using std::chrono::seconds;

namespace {

// That the server's log names; 0 when it does not.
int status_port(const std::string& log) {
  const std::string text = "status at http://127.0.0.1:";
  const auto at = log.find(text);
  return at == std::string::npos ? 0 : std::atoi(log.c_str() + at + text.size());
}

}  // namespace

Result<std::unique_ptr<BenchServer>> BenchServer::start(const std::vector<std::string>& arguments) {
  std::unique_ptr<BenchServer> server(new BenchServer);
  const dds::ParticipantOptions node = server->node();
  std::vector<std::string> all{"--map",    server->file("map.db"),     "--http", "127.0.0.1:0",
                               "--domain", std::to_string(node.domain)};
  all.insert(all.end(), arguments.begin(), arguments.end());
  server->process_ = std::make_unique<testing::Process>(
      std::string(CAIRN_BINARY_DIR) + "/cairn-server", all,
      std::vector<std::string>{"CYCLONEDDS_URI=" + node.config}, server->file("server"));
  if (!server->process_->wait_for_log("ready: ", seconds(60)))
    return {ErrorCode::kUnavailable, "cairn-server does not start: " + server->log()};
  return server;
}

Result<MapSize> BenchServer::map_size() const {
  httplib::Client client("127.0.0.1", status_port(log()));
  const auto answer = client.Get("/status");
  if (!answer) return {ErrorCode::kUnavailable, "the server's status page can't be had"};
  const auto status = nlohmann::json::parse(answer->body, nullptr, false);
  if (!status.contains("map")) return {ErrorCode::kInternal, "the status page has no map"};
  return MapSize{status["map"]["keyframes"], status["map"]["landmarks"]};
}

Status BenchServer::stop() {
  process_->signal(SIGTERM);
  if (process_->wait(seconds(60)) != 0)
    return {ErrorCode::kTimeout, "the server does not come to an end: " + log()};
  return {};
}

Result<Map> BenchServer::map() const {
  Result<std::unique_ptr<MapFile>> opened = MapFile::open(file("map.db"));
  if (!opened) return opened.error();
  Result<std::optional<Map>> loaded = (*opened)->load_map();
  if (!loaded) return loaded.error();
  if (!*loaded) return {ErrorCode::kInternal, "the server has saved no map"};
  return std::move(**loaded);
}

}  // namespace cairn::bench
