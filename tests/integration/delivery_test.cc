// Nothing is lost: servers that are not there, end, die and come back; clients that do.
#include <csignal>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

const std::string kPatience = std::to_string(60 * kTimeScale);  // --timeout, seconds

// What `cairn map info` says of a map file.
std::string map_info(Deployment& deployment, const std::string& map) {
  const auto tool = deployment.tool({"map", "info", map});
  EXPECT_EQ(tool->wait(seconds(30)), 0) << tool->err();
  return tool->out();
}

// That the server got all `count` keyframes of one run, whatever it has culled since.
void expect_received(const std::string& info, double count) {
  const std::string words = " of " + std::to_string(static_cast<int>(count)) + " received";
  EXPECT_NE(info.find(words), std::string::npos) << "no '" << words << "' in\n" << info;
}

TEST(Delivery, WithoutAServerAllKeyframesStayInTheOutboxAndGoOutWithTheNextRun) {
  Deployment deployment;
  const auto alone =
      deployment.client("walker", "synth:desk?frames=60", {"--max-rate", "--no-server"});
  ASSERT_EQ(alone->wait(seconds(60)), 3) << alone->err();
  EXPECT_EQ(alone->reported("tracked"), 60);
  const double kept = alone->reported("undelivered");
  EXPECT_EQ(kept, alone->reported("keyframes"));
  EXPECT_GE(kept, 2);
  EXPECT_TRUE(std::filesystem::exists(deployment.file("walker.outbox")));

  const auto server = deployment.server({"--map", deployment.file("map.db").string()});
  const auto second = deployment.client("walker", "synth:desk?frames=30", {"--lockstep"});
  ASSERT_EQ(second->wait(seconds(60)), 0) << second->err();
  EXPECT_EQ(second->reported("undelivered"), 0);
  EXPECT_FALSE(std::filesystem::exists(deployment.file("walker.outbox")));
  server->signal(SIGTERM);
  ASSERT_EQ(server->wait(seconds(30)), 0) << server->err();
  const std::string info = map_info(deployment, deployment.file("map.db").string());
  expect_received(info, kept);
  expect_received(info, second->reported("keyframes"));
}

TEST(Delivery, AServerThatComesLateGetsEverything) {
  Deployment deployment;
  const auto client = deployment.client("walker", "synth:desk?frames=90", {"--timeout", kPatience});
  ASSERT_TRUE(client->runs_for(seconds(4))) << client->err();
  const auto server = deployment.server();
  ASSERT_EQ(client->wait(seconds(90)), 0) << client->err();
  EXPECT_EQ(client->reported("undelivered"), 0);
  EXPECT_EQ(client->reported("mapped"), client->reported("keyframes"));
}

TEST(Delivery, AKilledServerContinuesFromItsFile) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  auto server = deployment.server({"--map", map});
  const std::string trajectory = deployment.file("out.tum").string();
  std::vector<std::string> arguments{"--timeout", kPatience, "--trajectory", trajectory};
  if (kSlowBuild) arguments.push_back("--max-rate");
  const auto client = deployment.client("walker", "synth:desk?frames=180", arguments);
  ASSERT_TRUE(client->wait_for_log("connected to the server", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(seconds(2))) << client->err();
  server->signal(SIGKILL);
  ASSERT_EQ(server->wait(seconds(10)), 128 + SIGKILL);
  server = deployment.server({"--map", map});
  ASSERT_EQ(client->wait(seconds(120)), 0) << client->err();
  EXPECT_EQ(client->reported("undelivered"), 0);
  EXPECT_EQ(client->reported("mapped"), client->reported("keyframes"));
  server->signal(SIGTERM);
  ASSERT_EQ(server->wait(seconds(30)), 0) << server->err();
  expect_received(map_info(deployment, map), client->reported("keyframes"));
  const Evaluation e = evaluate_file(truth_of({.scene = "desk", .frames = 180}), trajectory);
  EXPECT_LT(e.ate.rmse, 0.02);
}

// The new server's map is another one, and empty: what the old one had mapped stays where it was.
TEST(Delivery, AServerThatComesBackWithoutItsMapLeavesTheTrajectoryInOneFrame) {
  Deployment deployment;
  auto server = deployment.server();
  const std::string trajectory = deployment.file("out.tum").string();
  std::vector<std::string> arguments{"--timeout", kPatience, "--trajectory", trajectory};
  if (kSlowBuild) arguments.push_back("--max-rate");
  const auto client = deployment.client("walker", "synth:hall?frames=240", arguments);
  ASSERT_TRUE(client->wait_for_log("connected to the server", seconds(20))) << client->err();
  ASSERT_TRUE(client->wait_for_log("map started", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(seconds(3))) << client->err();
  server->signal(SIGKILL);
  ASSERT_EQ(server->wait(seconds(10)), 128 + SIGKILL);
  server = deployment.server();
  ASSERT_EQ(client->wait(seconds(120)), 0) << client->err();
  EXPECT_NE(client->err().find("another map"), std::string::npos) << client->err();
  EXPECT_EQ(client->reported("undelivered"), 0);
  EXPECT_EQ(client->reported("mapped"), client->reported("keyframes"));
  // A machine that stalls in real time may cost a few.
  EXPECT_GE(client->reported("tracked"), 0.95 * client->reported("frames"));
  const Evaluation e = evaluate_file(truth_of({.scene = "hall", .frames = 240}), trajectory);
  EXPECT_LT(e.ate.rmse, 0.03);
}

// Who does not answer is not waited for, neither by the choice of keyframes.
TEST(Delivery, WithTheLinkDownKeyframesAreMadeAsWithoutAServer) {
  if (kSlowBuild) GTEST_SKIP() << "needs real time; run it in another build";
  Deployment deployment;
  const std::string input = "synth:desk?frames=180";
  // Wants a keyframe often, but only where the mapper can take it.
  const std::string config =
      deployment.write("often.yaml", "tracking:\n  keyframe_min_shared: 0.9\n");
  const auto alone = deployment.client("alone", input, {"--max-rate", "--no-server"}, config);
  ASSERT_EQ(alone->wait(seconds(60)), 3) << alone->err();
  const auto waiting = deployment.client("waiting", input, {"--timeout", "0"}, config);
  ASSERT_EQ(waiting->wait(seconds(60)), 3) << waiting->err();
  EXPECT_GE(waiting->reported("keyframes"), 0.5 * alone->reported("keyframes"));
}

// A run that ends in trouble: what was tracked until then is written, and delivered later.
TEST(Delivery, ALockstepRunWhoseServerDiesWritesWhatItTracked) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const std::string trajectory = deployment.file("out.tum").string();
  auto server = deployment.server({"--map", map});
  ASSERT_TRUE(server->wait_for_log("ready", seconds(30))) << server->err();
  const auto client = deployment.client(
      "walker", "synth:hall?frames=3000",
      {"--lockstep", "--timeout", std::to_string(2 * kTimeScale), "--trajectory", trajectory});
  ASSERT_TRUE(client->wait_for_log("connected to the server", seconds(20))) << client->err();
  ASSERT_TRUE(client->wait_for_log("map started", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(seconds(2) * kTimeScale)) << client->err();
  server->signal(SIGKILL);
  ASSERT_EQ(client->wait(seconds(30)), 1) << client->err();
  EXPECT_NE(client->err().find("still await the server's mapping"), std::string::npos)
      << client->err();
  const Result<Trajectory> written = read_trajectory(trajectory);
  ASSERT_TRUE(written.ok()) << written.message();
  EXPECT_GT(written->size(), 5u);
  // The keyframe that was not answered is in the outbox or, where its acknowledgement came just
  // before the end, in the journal.
  server = deployment.server({"--map", map});
  const auto next = deployment.client("walker", "synth:desk?frames=5", {"--lockstep"});
  ASSERT_EQ(next->wait(seconds(60)), 0) << next->err();
  EXPECT_FALSE(std::filesystem::exists(deployment.file("walker.outbox")));
}

TEST(Delivery, TheOutboxOfAKilledClientIsDeliveredByTheNext) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const auto killed = deployment.client("walker", "synth:desk?frames=300", {"--no-server"});
  ASSERT_TRUE(killed->wait_for_log(" tracked, ", seconds(30))) << killed->err();
  ASSERT_TRUE(killed->runs_for(seconds(1))) << killed->err();  // its keyframe goes into the outbox
  killed->signal(SIGKILL);
  ASSERT_EQ(killed->wait(seconds(10)), 128 + SIGKILL);
  const auto server = deployment.server({"--map", map});
  const auto next = deployment.client("walker", "synth:desk?frames=30", {"--lockstep"});
  ASSERT_EQ(next->wait(seconds(60)), 0) << next->err();
  EXPECT_EQ(next->reported("undelivered"), 0);
  server->signal(SIGTERM);
  ASSERT_EQ(server->wait(seconds(30)), 0);
  const std::string info = map_info(deployment, map);
  std::size_t runs = 0;
  for (std::size_t at = info.find(" run "); at != std::string::npos;
       at = info.find(" run ", at + 1))
    ++runs;
  EXPECT_EQ(runs, 2u) << info;
}

TEST(Delivery, TwoClientsAreServedAtTheSameTime) {
  Deployment deployment;
  const auto server = deployment.server();
  const std::string a_file = deployment.file("a.tum").string();
  const std::string b_file = deployment.file("b.tum").string();
  const auto a =
      deployment.client("a", "synth:desk?frames=90&path=0", {"--max-rate", "--trajectory", a_file});
  const auto b =
      deployment.client("b", "synth:desk?frames=90&path=1", {"--max-rate", "--trajectory", b_file});
  ASSERT_EQ(a->wait(seconds(120)), 0) << a->err();
  ASSERT_EQ(b->wait(seconds(120)), 0) << b->err();
  const Evaluation ea = evaluate_file(truth_of({.scene = "desk", .path = 0, .frames = 90}), a_file);
  const Evaluation eb = evaluate_file(truth_of({.scene = "desk", .path = 1, .frames = 90}), b_file);
  EXPECT_LT(ea.ate.rmse, 0.015);
  EXPECT_LT(eb.ate.rmse, 0.015);
}

}  // namespace
}  // namespace cairn::testing
