// Bad input gets one clear line and a non-zero exit, or is counted and reported.
#include <algorithm>
#include <csignal>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "common/model/trajectory.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;
namespace fs = std::filesystem;

constexpr const char* kCamera =
    "sensor: rgbd\n"
    "camera:\n"
    "  resolution: [640, 480]\n"
    "  intrinsics: [525, 525, 319.5, 239.5]\n";

// The last line of stderr that is no log line: what the user is told.
std::string complaint(const Process& process) {
  std::istringstream lines(process.err());
  std::string line, last;
  while (std::getline(lines, line))
    if (line.rfind("cairn", 0) == 0) last = line;
  return last;
}

void expect_refused(Process& process, int code, const std::string& word) {
  ASSERT_EQ(process.wait(seconds(30)), code) << process.err();
  EXPECT_NE(complaint(process).find(word), std::string::npos)
      << "no line with '" << word << "' in\n"
      << process.err();
}

TEST(BadInput, AMissingFolder) {
  Deployment d;
  const auto client =
      d.client("c", "tum:/no/such/folder", {"--no-server"}, d.write("c.yaml", kCamera));
  expect_refused(*client, 2, "/no/such/folder");
}

TEST(BadInput, AnUnknownKindOfSource) {
  Deployment d;
  const auto client = d.client("c", "ftp:somewhere", {"--no-server"});
  expect_refused(*client, 2, "ftp");
}

TEST(BadInput, ARecordingWithoutFrames) {
  Deployment d;
  fs::create_directories(d.file("empty"));
  d.write("empty/rgb.txt", "# timestamp filename\n");
  d.write("empty/depth.txt", "# timestamp filename\n");
  const auto client =
      d.client("c", "tum:" + d.file("empty").string(), {"--no-server"}, d.write("c.yaml", kCamera));
  ASSERT_TRUE(client->wait(seconds(30)));
  EXPECT_NE(client->wait(seconds(0)), 0);
  EXPECT_FALSE(complaint(*client).empty()) << client->err();
}

TEST(BadInput, IntrinsicsThatAreNoNumbers) {
  Deployment d;
  const std::string config = d.write("c.yaml",
                                     "sensor: rgbd\ncamera:\n  resolution: [640, 480]\n"
                                     "  intrinsics: [.nan, 525, 319.5, 239.5]\n");
  const auto client = d.client("c", "synth:desk", {"--no-server"}, config);
  expect_refused(*client, 2, "c.yaml:4: camera.intrinsics");
}

TEST(BadInput, MalformedYaml) {
  Deployment d;
  const auto client =
      d.client("c", "synth:desk", {"--no-server"}, d.write("c.yaml", "camera: [1, 2\n"));
  expect_refused(*client, 2, "c.yaml");
}

TEST(BadInput, AMisspeltKey) {
  Deployment d;
  const auto client = d.client("c", "synth:desk", {"--no-server"},
                               d.write("c.yaml", "trakcing:\n  min_inliers: 20\n"));
  expect_refused(*client, 2, "trakcing");
}

TEST(BadInput, AnUnknownOption) {
  Deployment d;
  const auto client = d.client("c", "synth:desk", {"--no-such-option"});
  ASSERT_EQ(client->wait(seconds(30)), 2) << client->err();
  const auto server = d.server({"--no-such-option"});
  ASSERT_EQ(server->wait(seconds(30)), 2) << server->err();
}

// A small recording of the desk, written by cairn synth.
void write_recording(Deployment& d, int frames) {
  const auto synth = d.tool({"synth", "--scene", "desk", "--frames", std::to_string(frames),
                             "--out", d.file("rec").string()});
  ASSERT_EQ(synth->wait(seconds(60)), 0) << synth->err();
}

std::vector<fs::path> sorted_files(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

TEST(BadInput, AnUnreadableImageIsSkippedAndCounted) {
  Deployment d;
  ASSERT_NO_FATAL_FAILURE(write_recording(d, 12));
  std::ofstream(sorted_files(d.file("rec/rgb"))[5]) << "this is no image";
  const auto client = d.client("c", "tum:" + d.file("rec").string(), {"--no-server", "--max-rate"},
                               d.file("rec/client.yaml").string());
  ASSERT_EQ(client->wait(seconds(60)), 3) << client->err();
  EXPECT_EQ(client->reported("skipped"), 1);
  EXPECT_EQ(client->reported("tracked"), 11);
}

TEST(BadInput, DepthOfAnotherSizeIsSkippedAndCounted) {
  Deployment d;
  ASSERT_NO_FATAL_FAILURE(write_recording(d, 12));
  const auto depth = sorted_files(d.file("rec/depth"));
  // A small but sound PNG: 1 x 1, 16 bits of grey.
  const unsigned char png[] = {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a, 0,    0,    0, 0x0d,
                               'I',  'H', 'D', 'R', 0,    0,    0,    1,    0,    0,    0, 1,
                               0x10, 0,   0,   0,   0,    0x6a, 0xdb, 0x7d, 0xc2, 0,    0, 0,
                               0x0b, 'I', 'D', 'A', 'T',  0x78, 0x9c, 0x63, 0x60, 0x60, 0, 0,
                               0,    3,   0,   1,   0xb8, 0xad, 0x3a, 0x63, 0,    0,    0, 0,
                               'I',  'E', 'N', 'D', 0xae, 0x42, 0x60, 0x82};
  std::ofstream(depth[4], std::ios::binary).write(reinterpret_cast<const char*>(png), sizeof(png));
  const auto client = d.client("c", "tum:" + d.file("rec").string(), {"--no-server", "--max-rate"},
                               d.file("rec/client.yaml").string());
  ASSERT_EQ(client->wait(seconds(60)), 3) << client->err();
  EXPECT_EQ(client->reported("skipped"), 1);
}

// The end of a recording that was copied in part.
TEST(BadInput, UnreadableImagesAtTheEndCostNoKeyframeAndNoTrajectory) {
  Deployment d;
  ASSERT_NO_FATAL_FAILURE(write_recording(d, 12));
  const auto images = sorted_files(d.file("rec/rgb"));
  for (std::size_t i = 8; i < 12; ++i) fs::resize_file(images[i], 100);
  const auto server = d.server();
  const std::string trajectory = d.file("out.tum").string();
  const auto client =
      d.client("c", "tum:" + d.file("rec").string(), {"--lockstep", "--trajectory", trajectory},
               d.file("rec/client.yaml").string());
  ASSERT_EQ(client->wait(seconds(60)), 0) << client->err();
  EXPECT_EQ(client->reported("skipped"), 4);
  EXPECT_EQ(client->reported("undelivered"), 0);
  EXPECT_EQ(client->reported("acknowledged"), client->reported("keyframes"));
  const Result<Trajectory> written = read_trajectory(trajectory);
  ASSERT_TRUE(written.ok()) << written.message();
  EXPECT_EQ(written->size(), 8u);
}

TEST(BadInput, FramesThatCannotBeTracked) {
  Deployment d;
  const std::string config = d.write("c.yaml", "tracking:\n  min_start_features: 10000\n");
  const auto client = d.client("c", "synth:desk?frames=4", {"--no-server", "--max-rate"}, config);
  expect_refused(*client, 1, "no frame was tracked");
  EXPECT_EQ(client->reported("tracked"), 0);
}

TEST(BadInput, ATrajectoryThatCannotBeWrittenShowsBeforeTheRun) {
  Deployment d;
  const std::vector<std::string> places{"/no/such/folder/out.tum", d.file(".").string()};
  for (const std::string& place : places) {
    const auto client =
        d.client("c", "synth:desk?frames=3000", {"--no-server", "--trajectory", place});
    expect_refused(*client, 2, place);
  }
  EXPECT_FALSE(fs::exists(d.file("c.outbox")));
}

TEST(BadInput, AStartThatFailsLeavesTheLastTrajectoryAlone) {
  Deployment d;
  const std::string former = d.write("former.tum", "1 0 0 0 0 0 0 1\n");
  for (const std::string& file : {former, d.file("new.tum").string()}) {
    const auto client = d.client("c", "tum:/no/such/folder", {"--no-server", "--trajectory", file},
                                 d.write("c.yaml", kCamera));
    expect_refused(*client, 2, "/no/such/folder");
  }
  EXPECT_EQ(fs::file_size(former), 16u);
  EXPECT_FALSE(fs::exists(d.file("new.tum")));
}

TEST(BadInput, AnUnknownLogLevel) {
  Deployment d;
  const std::string config = d.write("c.yaml", "log_level: loud\n");
  const std::string levels = "debug, info, warn, error, off";
  expect_refused(*d.client("c", "synth:desk", {"--no-server"}, config), 2, levels);
  expect_refused(*d.server({"--config", config}), 2, levels);
  const auto client = d.client("c", "synth:desk", {"--no-server", "--log-level", "loud"});
  const auto server = d.server({"--log-level", "loud"});
  for (Process* program : {client.get(), server.get()}) {
    ASSERT_EQ(program->wait(seconds(30)), 2) << program->err();
    EXPECT_NE(program->err().find(levels), std::string::npos) << program->err();
  }
}

TEST(BadInput, AMapFileOfAnotherProgram) {
  Deployment d;
  const auto server = d.server({"--map", d.write("map.db",
                                                 "this is no map, but long enough to be "
                                                 "taken for one by a careless reader....")});
  ASSERT_TRUE(server->wait(seconds(30)));
  EXPECT_NE(server->wait(seconds(0)), 0);
  EXPECT_NE(complaint(*server).find("map.db"), std::string::npos) << server->err();
}

TEST(BadInput, AnOccupiedPort) {
  Deployment d;
  const auto first = d.server({"--http", "127.0.0.1:0"});
  ASSERT_TRUE(first->wait_for_log("http://127.0.0.1:", seconds(20))) << first->err();
  const std::string log = first->err();
  const std::size_t at = log.find("http://127.0.0.1:") + 17;
  const std::string port = log.substr(at, log.find_first_not_of("0123456789", at) - at);
  const auto second = d.server({"--http", "127.0.0.1:" + port});
  ASSERT_EQ(second->wait(seconds(30)), 1) << second->err();
  EXPECT_NE(complaint(*second).find(port), std::string::npos) << second->err();
}

}  // namespace
}  // namespace cairn::testing
