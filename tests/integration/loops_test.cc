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

// Both clients start in parts of their own, in different places of one room.
TEST(Loops, ClientsThatSeeTheSameRoomShareOneMap) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const auto server = deployment.server({"--map", map});
  const std::vector<std::string> names{"alice", "bob"};
  const int frames = 200;
  std::vector<std::unique_ptr<Process>> clients;
  std::vector<std::string> trajectories;
  for (std::size_t i = 0; i < names.size(); ++i) {
    trajectories.push_back(deployment.file(names[i] + ".tum").string());
    clients.push_back(deployment.client(
        names[i],
        "synth:desk?frames=" + std::to_string(frames) + "&path=" + std::to_string(i),
        {"--max-rate", "--trajectory", trajectories.back()}));
  }
  for (const auto& client : clients) EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
  server->signal(SIGTERM);
  EXPECT_EQ(server->wait(seconds(60)), 0) << server->err();
  EXPECT_NE(server->err().find("parts merged"), std::string::npos) << server->err();

  // One alignment for both: they are in one frame.
  Trajectory truth, joint;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto shift = static_cast<std::int64_t>(i) * 1'000'000'000'000;  // stamps of their own
    for (StampedPose pose :
         truth_of({.scene = "desk", .path = static_cast<int>(i), .frames = frames})) {
      pose.stamp_ns += shift;
      truth.push_back(pose);
    }
    const Result<Trajectory> estimate = read_trajectory(trajectories[i]);
    ASSERT_TRUE(estimate) << estimate.message();
    for (StampedPose pose : *estimate) {
      pose.stamp_ns += shift;
      joint.push_back(pose);
    }
  }
  const std::string file = deployment.file("joint.tum").string();
  ASSERT_TRUE(write_trajectory(file, joint));
  EXPECT_LT(evaluate_file(truth, file).ate.rmse, 0.01);

  const auto info = deployment.tool({"map", "info", map});
  EXPECT_EQ(info->wait(seconds(30)), 0);
  EXPECT_NE(info->out().find("merge"), std::string::npos) << info->out();
}

// Equal posters and equal bricks on a way that comes by nothing twice.
TEST(Loops, WhatOnlyLooksAlikeIsNoLoop) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  for (const char* scene : {"posters", "bricks"}) {
    Deployment deployment;
    const auto server = deployment.server();
    const std::string trajectory = deployment.file("out.tum").string();
    const auto client =
        deployment.client("walker", std::string("synth:") + scene + "?frames=300",
                          {"--max-rate", "--trajectory", trajectory});
    EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
    EXPECT_EQ(server->err().find("loop closed"), std::string::npos) << server->err();
    EXPECT_LT(evaluate_file(truth_of({.scene = scene, .frames = 300}), trajectory).ate.rmse, 0.05)
        << scene;
  }
}

}  // namespace
}  // namespace cairn::testing
