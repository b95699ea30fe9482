// What goes over the network between a client and the server, by their own count.
#include <csignal>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

struct Delivered {
  double up = 0, down = 0;  // kilobytes a second of the recording
  double ate = 0;           // metres
  std::string log;          // the server's
};

// The desk in lockstep, where every run is the same.
Delivered run_desk(const std::string& server_config) {
  constexpr int kFrames = 200;
  Deployment deployment;
  std::vector<std::string> arguments;
  if (!server_config.empty())
    arguments = {"--config", deployment.write("server.yaml", server_config)};
  const auto server = deployment.server(arguments);
  const std::string trajectory = deployment.file("out.tum").string();
  const auto client = deployment.client("walker", "synth:desk?frames=200",
                                        {"--lockstep", "--trajectory", trajectory});
  EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
  EXPECT_EQ(client->reported("tracked"), kFrames);
  server->signal(SIGTERM);
  EXPECT_EQ(server->wait(seconds(30)), 0) << server->err();
  const synthetic::SequenceOptions options{.scene = "desk", .frames = kFrames};
  return {client->reported("up_kB_per_s"), client->reported("down_kB_per_s"),
          evaluate_file(truth_of(options), trajectory).ate.rmse, server->err()};
}

TEST(Bandwidth, AClientNeedsNoMoreThanItShould) {
  const Delivered run = run_desk("");
  EXPECT_LE(run.up, 150);
  EXPECT_LE(run.down, 50);
  EXPECT_LT(run.ate, 0.01);
  // And the server says so.
  EXPECT_NE(run.log.find("client walker left after"), std::string::npos) << run.log;
  EXPECT_NE(run.log.find("map updates"), std::string::npos) << run.log;
}

TEST(Bandwidth, ATighterBudgetIsKeptAndTheClientStillTracks) {
  const Delivered run = run_desk("downlink:\n  kilobytes_per_s: 6\n  saved_kilobytes: 6\n");
  EXPECT_GT(run.down, 2);
  EXPECT_LE(run.down, 10);  // poses and what is gone are sent all the same
  EXPECT_LT(run.ate, 0.02);
}

}  // namespace
}  // namespace cairn::testing
