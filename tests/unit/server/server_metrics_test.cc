#include "server/server_metrics.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace cairn {
namespace {

ServerState busy_state() {
  ServerState state;
  ClientInfo alice;
  alice.client = {"alice", 7};
  alice.traffic = {
      .keyframes = 300'000, .questions = 40'000, .map_updates = 90'000, .answers = 500};
  alice.seconds = 10;
  state.clients = {alice};
  state.ingest.traffic = {
      .keyframes = 900'000, .questions = 40'000, .map_updates = 100'000, .answers = 500};
  return state;
}

TEST(ServerMetrics, TheStatusTellsBytesByTopicAndClient) {
  const auto json = nlohmann::json::parse(to_json(busy_state()));
  EXPECT_EQ(json["bytes"]["keyframe"], 900'000);
  EXPECT_EQ(json["ingest"]["bytes_in"], 940'000);
  EXPECT_EQ(json["ingest"]["bytes_out"], 100'500);
  const auto& alice = json["clients"][0];
  EXPECT_EQ(alice["bytes"]["relocalise_request"], 40'000);
  EXPECT_EQ(alice["bytes"]["map_update"], 90'000);
  EXPECT_EQ(alice["bytes"]["relocalise_answer"], 500);
  EXPECT_EQ(alice["up_kB_per_s"], 34.0);
  EXPECT_EQ(alice["down_kB_per_s"], 9.1);
}

TEST(ServerMetrics, PrometheusGetsBytesByTopicAndClient) {
  const std::string text = to_prometheus(busy_state());
  for (const char* line :
       {"cairn_client_bytes_total{client=\"alice\",topic=\"keyframe\"} 300000\n",
        "cairn_client_bytes_total{client=\"alice\",topic=\"map_update\"} 90000\n",
        "cairn_received_bytes_total 940000\n", "cairn_sent_bytes_total 100500\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << text;
}

TEST(ServerMetrics, AClientThatHasJustComeHasNoRate) {
  ServerState state = busy_state();
  state.clients[0].seconds = 0;
  EXPECT_EQ(nlohmann::json::parse(to_json(state))["clients"][0]["up_kB_per_s"], 0.0);
}

}  // namespace
}  // namespace cairn
