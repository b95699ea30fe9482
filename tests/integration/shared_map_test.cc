// Several clients, one map, with the real programs.
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

std::string spec(const synthetic::SequenceOptions& o) {
  return "synth:" + o.scene + "?frames=" + std::to_string(o.frames) +
         "&path=" + std::to_string(o.path) + (o.sensor == Sensor::kStereo ? "&sensor=stereo" : "");
}

// A server with a map file, and clients that run at the same time.
class SharedMap {
 public:
  SharedMap() : server_(deployment.server({"--map", map_})) {}

  void add(const std::string& name, const std::string& input, Trajectory truth,
           const std::string& config = "") {
    runs_.push_back({std::move(truth), deployment.file(name + ".tum").string()});
    clients_.push_back(
        deployment.client(name, input, {"--max-rate", "--trajectory", runs_.back().file}, config));
  }
  void add(const std::string& name, const synthetic::SequenceOptions& options) {
    add(name, spec(options), truth_of(options));
  }

  // Waits for all of them and ends the server; their joint ATE, metres.
  double finish() {
    for (const auto& client : clients_) EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
    end_server();
    return joint_ate(runs_);
  }
  void end_server() {
    server_->signal(SIGTERM);
    EXPECT_EQ(server_->wait(seconds(60)), 0) << server_->err();
  }
  // What `cairn map info` says.
  std::string info() {
    const auto tool = deployment.tool({"map", "info", map_});
    EXPECT_EQ(tool->wait(seconds(30)), 0) << tool->err();
    return tool->out();
  }
  Process& server() { return *server_; }

  Deployment deployment;

 private:
  const std::string map_ = deployment.file("map.db").string();
  std::unique_ptr<Process> server_;
  std::vector<JointRun> runs_;
  std::vector<std::unique_ptr<Process>> clients_;
};

class ClientsInOneRoom : public ::testing::TestWithParam<int> {};

// All start in parts of their own, in different places of one room.
TEST_P(ClientsInOneRoom, ShareOneMap) {
  if (kSlowBuild && GetParam() > 2) GTEST_SKIP() << "two of them do under sanitizers";
  SharedMap shared;
  for (int i = 0; i < GetParam(); ++i)
    shared.add("client" + std::to_string(i), {.scene = "desk", .path = i, .frames = 200});
  EXPECT_LT(shared.finish(), 0.01);
  EXPECT_NE(shared.server().err().find("parts merged"), std::string::npos) << shared.server().err();
}

INSTANTIATE_TEST_SUITE_P(Many, ClientsInOneRoom, ::testing::Values(2, 3));

TEST(SharedMap, OfDifferentSensors) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  SharedMap shared;
  shared.add("depth", {.scene = "desk", .path = 0, .frames = 200});
  shared.add("stereo", {.scene = "desk", .path = 1, .frames = 200, .sensor = Sensor::kStereo});
  EXPECT_LT(shared.finish(), 0.02);
}

// The lines first .. last-1 of a list of a TUM folder, its paths made absolute.
void write_part(const std::filesystem::path& folder, const std::string& list, int first, int last,
                const std::filesystem::path& out) {
  std::filesystem::create_directories(out);
  std::ifstream in(folder / list);
  std::ofstream part(out / list);
  int row = 0;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    if (row >= first && row < last) {
      std::istringstream columns(line);
      std::string stamp, path;
      columns >> stamp >> path;
      part << stamp << ' ' << (folder / path).string() << '\n';
    }
    ++row;
  }
}

TEST(SharedMap, OfTwoHalvesOfARecording) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const auto folder = recording("sevenscenes_kitchen_400");
  if (!folder) GTEST_SKIP() << "no recording sevenscenes_kitchen_400; set CAIRN_DATA";
  const Result<Trajectory> truth = read_trajectory((*folder / "groundtruth.txt").string());
  ASSERT_TRUE(truth) << truth.message();
  SharedMap shared;
  const std::pair<int, int> halves[] = {{0, 230}, {170, 400}};
  for (const auto& [first, last] : halves) {
    const std::string name = "from" + std::to_string(first);
    for (const char* list : {"rgb.txt", "depth.txt"})
      write_part(*folder, list, first, last, shared.deployment.file(name));
    shared.add(name, "tum:" + shared.deployment.file(name).string(), *truth,
               std::string(CAIRN_SOURCE_DIR) + "/config/client_7scenes.yaml");
  }
  EXPECT_LT(shared.finish(), 0.03);
}

// Its keyframes stay, and who comes next is in one map with them.
TEST(SharedMap, WithAClientThatLeftWithoutGoodbye) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  SharedMap shared;
  const auto gone = shared.deployment.client("gone", "synth:desk?frames=3000&path=0");
  ASSERT_TRUE(gone->wait_for_log("connected to the server", seconds(20))) << gone->err();
  ASSERT_TRUE(gone->wait_for_log("map started", seconds(20))) << gone->err();
  ASSERT_TRUE(gone->runs_for(seconds(5))) << gone->err();
  gone->signal(SIGKILL);
  ASSERT_EQ(gone->wait(seconds(10)), 128 + SIGKILL);
  shared.add("stays", {.scene = "desk", .path = 0, .frames = 120});
  EXPECT_LT(shared.finish(), 0.01);
  EXPECT_NE(shared.server().err().find("parts merged"), std::string::npos) << shared.server().err();
  EXPECT_NE(shared.info().find("gone"), std::string::npos);
}

TEST(SharedMap, RefusesASecondClientOfOneName) {
  SharedMap shared;
  const auto first = shared.deployment.client("twin", "synth:desk?frames=3000");
  ASSERT_TRUE(first->wait_for_log("connected to the server", seconds(20))) << first->err();
  const auto second = shared.deployment.client(
      "twin", "synth:desk?frames=5",
      {"--max-rate", "--timeout", "5", "--outbox", shared.deployment.file("other").string()});
  EXPECT_EQ(second->wait(seconds(60)), 3) << "tracked, and nothing delivered: " << second->err();
  EXPECT_NE(second->err().find("a client of that name is connected"), std::string::npos)
      << second->err();
  EXPECT_NE(second->err().find("--name"), std::string::npos) << "what to do";
}

}  // namespace
}  // namespace cairn::testing
