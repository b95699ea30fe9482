// Every end of a program: asked for, hurried or violent, it costs no keyframe.
#include <csignal>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "common/model/trajectory.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

// Keyframes that the map file has received, all runs together; `cairn map info` lists the runs.
int received(Deployment& deployment, const std::string& map) {
  const auto tool = deployment.tool({"map", "info", map});
  EXPECT_EQ(tool->wait(seconds(30)), 0) << tool->err();
  std::istringstream words(tool->out());
  int sum = 0, number = 0;
  for (std::string before, word; words >> word; before = word)
    if (before == "of" && std::istringstream(word) >> number) sum += number;
  return sum;
}

// Each repetition (--gtest_repeat) interrupts at another moment.
milliseconds some_moment() {
  static int call = 0;
  return milliseconds(300 + 170 * (call++ % 10));
}

void expect_ends_well(Process& server) {
  server.signal(SIGTERM);
  EXPECT_EQ(server.wait(seconds(30)), 0) << server.err();
}

// Delivers what is in the outbox of "walker" to a new server on `map`.
void deliver_the_rest(Deployment& deployment, const std::string& map, double* keyframes) {
  const auto server = deployment.server({"--map", map});
  const auto next = deployment.client("walker", "synth:desk?frames=5", {"--lockstep"});
  ASSERT_EQ(next->wait(seconds(60)), 0) << next->err();
  *keyframes += next->reported("keyframes");
  expect_ends_well(*server);
}

TEST(Shutdown, AServerThatEndsUnderAFullStreamHasSavedWhatItAcknowledged) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const auto server = deployment.server({"--map", map});
  const auto client = deployment.client("walker", "synth:desk?frames=400",
                                        {"--max-rate", "--timeout", std::to_string(kTimeScale)});
  ASSERT_TRUE(client->wait_for_log("connected to the server", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(some_moment() * kTimeScale)) << client->err();
  expect_ends_well(*server);
  ASSERT_EQ(client->wait(seconds(60)), 3) << client->err();
  EXPECT_EQ(client->reported("tracked"), 400) << "tracking does not need the server";
  const double made = client->reported("keyframes");
  EXPECT_GE(received(deployment, map), made - client->reported("undelivered"));
  double all = made;
  ASSERT_NO_FATAL_FAILURE(deliver_the_rest(deployment, map, &all));
  EXPECT_EQ(received(deployment, map), all);
}

TEST(Shutdown, AnInterruptedClientWritesItsTrajectoryAndLosesNothing) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const std::string file = deployment.file("out.tum").string();
  const auto server = deployment.server({"--map", map});
  const auto client =
      deployment.client("walker", "synth:desk?frames=3000", {"--max-rate", "--trajectory", file});
  ASSERT_TRUE(client->wait_for_log("connected to the server", seconds(20))) << client->err();
  ASSERT_TRUE(client->wait_for_log("map started", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(some_moment() * kTimeScale)) << client->err();
  client->signal(SIGINT);
  const std::optional<int> code = client->wait(seconds(10));
  ASSERT_TRUE(code == 0 || code == 3) << client->err();
  EXPECT_EQ(code == 3, client->reported("undelivered") > 0);
  const Result<Trajectory> trajectory = read_trajectory(file);
  ASSERT_TRUE(trajectory.ok()) << trajectory.message();
  EXPECT_EQ(trajectory->size(), client->reported("tracked"));
  EXPECT_GT(trajectory->size(), 0u);
  double all = client->reported("keyframes");
  expect_ends_well(*server);
  ASSERT_NO_FATAL_FAILURE(deliver_the_rest(deployment, map, &all));
  EXPECT_EQ(received(deployment, map), all);
}

TEST(Shutdown, AnInterruptedClientDoesNotWaitForAServerThatIsNotThere) {
  Deployment deployment;
  const std::string file = deployment.file("out.tum").string();
  const auto client = deployment.client("walker", "synth:desk?frames=3000",
                                        {"--trajectory", file, "--timeout", "600"});
  ASSERT_TRUE(client->wait_for_log("map started", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(some_moment() * kTimeScale)) << client->err();
  client->signal(SIGINT);
  ASSERT_EQ(client->wait(seconds(8)), 3) << client->err();
  const Result<Trajectory> trajectory = read_trajectory(file);
  ASSERT_TRUE(trajectory.ok()) << trajectory.message();
  EXPECT_EQ(trajectory->size(), client->reported("tracked"));
}

// The same while it waits at the end: the frames are through, the server is not there.
TEST(Shutdown, AClientThatWaitsForDeliveryCanBeInterrupted) {
  Deployment deployment;
  const auto client =
      deployment.client("walker", "synth:desk?frames=4", {"--max-rate", "--timeout", "600"});
  ASSERT_TRUE(client->wait_for_log("waiting for the server", seconds(20))) << client->err();
  client->signal(SIGINT);
  ASSERT_EQ(client->wait(seconds(8)), 3) << client->err();
  EXPECT_EQ(client->reported("frames"), 4);
  EXPECT_EQ(client->reported("undelivered"), client->reported("keyframes"));
}

// A recording with a pause in its stamps is played with that pause.
TEST(Shutdown, AClientThatWaitsForAFrameFarAwayCanBeInterrupted) {
  Deployment deployment;
  const auto synth = deployment.tool(
      {"synth", "--scene", "desk", "--frames", "8", "--out", deployment.file("rec").string()});
  ASSERT_EQ(synth->wait(seconds(60)), 0) << synth->err();
  for (const char* list : {"rec/rgb.txt", "rec/depth.txt"}) {
    std::ifstream in(deployment.file(list));
    std::ostringstream text;
    int frames = 0;
    for (std::string line; std::getline(in, line);) {
      const std::size_t blank = line.find(' ');
      if (line[0] != '#' && ++frames > 4)
        line = std::to_string(std::stod(line.substr(0, blank)) + 86400) + line.substr(blank);
      text << line << "\n";
    }
    deployment.write(list, text.str());
  }
  const std::string file = deployment.file("out.tum").string();
  const auto client = deployment.client("walker", "tum:" + deployment.file("rec").string(),
                                        {"--no-server", "--trajectory", file},
                                        deployment.file("rec/client.yaml").string());
  ASSERT_TRUE(client->wait_for_log("map started", seconds(20))) << client->err();
  ASSERT_TRUE(client->runs_for(seconds(2) * kTimeScale)) << client->err();
  client->signal(SIGINT);
  ASSERT_EQ(client->wait(seconds(5)), 3) << client->err();
  // A slow build is late for some of them.
  EXPECT_EQ(client->reported("frames") + client->reported("dropped"), 4);
}

// The pause for the mapping of the first keyframes ends when no server comes; it must not come back
// with every keyframe.
TEST(Shutdown, FullRateWithoutAServerWaitsForItOnce) {
  Deployment deployment;
  const auto client =
      deployment.client("walker", "synth:hall?frames=100", {"--max-rate", "--timeout", "0"});
  ASSERT_EQ(client->wait(seconds(20)), 3) << client->err();
  EXPECT_EQ(client->reported("tracked"), 100);
  EXPECT_GE(client->reported("keyframes"), 6) << "too few for the pause to show";
}

TEST(Shutdown, AServerKilledBetweenJournalAndSaveMapsItAllAgain) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const std::string config = deployment.write("server.yaml", "save_every_s: 86400\n");
  auto server = deployment.server({"--map", map, "--config", config});
  const auto client = deployment.client("walker", "synth:desk?frames=60", {"--lockstep"});
  ASSERT_EQ(client->wait(seconds(60)), 0) << client->err();
  server->signal(SIGKILL);
  ASSERT_EQ(server->wait(seconds(10)), 128 + SIGKILL);

  server = deployment.server({"--map", map, "--config", config});
  const std::string made = std::to_string(static_cast<int>(client->reported("keyframes")));
  EXPECT_TRUE(server->wait_for_log(made + " journaled keyframes to map again", seconds(30)))
      << server->err();
  ASSERT_TRUE(server->wait_for_log("ready", seconds(30))) << server->err();
  expect_ends_well(*server);
  EXPECT_EQ(received(deployment, map), client->reported("keyframes"));
  const auto tool = deployment.tool({"map", "info", map});
  ASSERT_EQ(tool->wait(seconds(30)), 0) << tool->err();
  EXPECT_EQ(tool->out().find("keyframes    0"), std::string::npos) << tool->out();
}

TEST(Shutdown, AServerKilledWhileItEndsLeavesASoundFile) {
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  auto server = deployment.server({"--map", map});
  const auto client = deployment.client("walker", "synth:desk?frames=60", {"--max-rate"});
  ASSERT_EQ(client->wait(seconds(60)), 0) << client->err();
  for (int i = 0; i < 4; ++i) {
    server->signal(SIGTERM);
    server->runs_for(milliseconds(5 * i) * kTimeScale);
    server->signal(SIGKILL);
    const std::optional<int> code = server->wait(seconds(10));
    ASSERT_TRUE(code == 0 || code == 128 + SIGKILL) << server->err();
    server = deployment.server({"--map", map});
    ASSERT_TRUE(server->wait_for_log("ready", seconds(30))) << server->err();
  }
  expect_ends_well(*server);
  EXPECT_EQ(received(deployment, map), client->reported("keyframes"));
}

}  // namespace
}  // namespace cairn::testing
