// Loops and merges from image to corrected trajectory, with the real programs.
#include <csignal>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

double ate_in_corridor(const std::string& server_config) {
  Deployment deployment;
  std::vector<std::string> arguments;
  if (!server_config.empty())
    arguments = {"--config", deployment.write("server.yaml", server_config)};
  const auto server = deployment.server(arguments);
  const std::string trajectory = deployment.file("out.tum").string();
  const auto client = deployment.client("walker", "synth:corridor?frames=1250",
                                        {"--max-rate", "--trajectory", trajectory});
  EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
  EXPECT_EQ(client->reported("tracked"), 1250);
  server->signal(SIGTERM);
  EXPECT_EQ(server->wait(seconds(30)), 0) << server->err();
  return evaluate_file(truth_of({.scene = "corridor", .frames = 1250}), trajectory).ate.rmse;
}

// Once round the corridor, and some metres into the second round.
TEST(Loops, ALongLoopIsClosed) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  EXPECT_LT(ate_in_corridor(""), 0.02);
}

// Equal posters and equal bricks on a way that comes by nothing twice.
TEST(Loops, WhatOnlyLooksAlikeIsNoLoop) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  for (const char* scene : {"posters", "bricks"}) {
    Deployment deployment;
    const auto server = deployment.server();
    const std::string trajectory = deployment.file("out.tum").string();
    const auto client = deployment.client("walker", std::string("synth:") + scene + "?frames=300",
                                          {"--max-rate", "--trajectory", trajectory});
    EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
    EXPECT_EQ(server->err().find("loop closed"), std::string::npos) << server->err();
    EXPECT_LT(evaluate_file(truth_of({.scene = scene, .frames = 300}), trajectory).ate.rmse, 0.05)
        << scene;
  }
}

}  // namespace
}  // namespace cairn::testing
