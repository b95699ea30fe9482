// Cameras without depth in a map with others, and in several parts of it: scale, frames and files.
#include <csignal>
#include <filesystem>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;
using synthetic::SequenceOptions;

std::string spec(const SequenceOptions& o) {
  std::string text = "synth:" + o.scene + "?frames=" + std::to_string(o.frames) +
                     "&path=" + std::to_string(o.path) + "&start=" + std::to_string(o.start_s) +
                     (o.sensor == Sensor::kMono ? "&sensor=mono" : "");
  if (o.black_until > o.black_from)
    text += "&black=" + std::to_string(o.black_from) + "-" + std::to_string(o.black_until) +
            "&jump=" + std::to_string(o.jump_at) + ":" + std::to_string(o.jump_s);
  return text;
}

void end(Process& server) {
  server.signal(SIGTERM);
  EXPECT_EQ(server.wait(seconds(60)), 0) << server.err();
}

// One that has metres, one that has none, from different places of one room.
const SequenceOptions kDepth{.scene = "desk", .path = 1, .frames = 150};
const SequenceOptions kMono{.scene = "desk", .path = 0, .frames = 300, .sensor = Sensor::kMono};

// The single camera's map gets its scale, and it goes on in it, when the other one comes.
TEST(MonoMap, GetsItsMetresFromACameraWithDepthThatComesLater) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  Deployment deployment;
  const auto server = deployment.server();
  const std::string of_mono = deployment.file("mono.tum"), of_depth = deployment.file("depth.tum");
  const auto mono = deployment.client("mono", spec(kMono), {"--lockstep", "--trajectory", of_mono});
  ASSERT_TRUE(mono->wait_for_log("map started", seconds(60))) << mono->err();
  const auto depth =
      deployment.client("depth", spec(kDepth), {"--lockstep", "--trajectory", of_depth});
  EXPECT_EQ(depth->wait(seconds(120)), 0) << depth->err();
  EXPECT_EQ(mono->wait(seconds(120)), 0) << mono->err();
  end(*server);
  EXPECT_NE(server->err().find("parts merged"), std::string::npos) << server->err();
  EXPECT_EQ(mono->reported("tracked"), 300);
  EXPECT_EQ(mono->reported("parts"), 1);
  EXPECT_LE(joint_ate({{truth_of(kMono), of_mono}, {truth_of(kDepth), of_depth}}), 0.02);
}

TEST(MonoMap, IsInMetresWhereACameraWithDepthHasBeenBefore) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  Deployment deployment;
  const auto server = deployment.server();
  const std::string of_mono = deployment.file("mono.tum"), of_depth = deployment.file("depth.tum");
  const auto depth =
      deployment.client("depth", spec(kDepth), {"--lockstep", "--trajectory", of_depth});
  ASSERT_TRUE(depth->wait_for_log("connected to the server", seconds(60))) << depth->err();
  ASSERT_TRUE(depth->wait_for_log("map started", seconds(60))) << depth->err();
  const auto mono = deployment.client("mono", spec(kMono), {"--lockstep", "--trajectory", of_mono});
  EXPECT_EQ(depth->wait(seconds(120)), 0) << depth->err();
  EXPECT_EQ(mono->wait(seconds(120)), 0) << mono->err();
  end(*server);
  EXPECT_GE(mono->reported("tracked"), 285);
  EXPECT_EQ(mono->reported("parts"), 1);
  EXPECT_LE(joint_ate({{truth_of(kMono), of_mono}, {truth_of(kDepth), of_depth}}), 0.02);
}

// Black images, then another place, where it starts anew; with enough frames it walks to where it
// had begun.
SequenceOptions lost_way(Sensor sensor, int frames) {
  return {.scene = "hall",
          .frames = frames,
          .start_s = 20,
          .sensor = sensor,
          .black_from = 90,
          .black_until = 120,
          .jump_at = 120,
          .jump_s = -15};
}

struct LostRun {
  explicit LostRun(const SequenceOptions& way) : truth(truth_of(way)) {
    const auto server = deployment.server();
    client = deployment.client("walker", spec(way), {"--lockstep", "--trajectory", file(1)});
    EXPECT_EQ(client->wait(seconds(240)), 0) << client->err();
    EXPECT_NE(client->err().find("starting a new part"), std::string::npos) << client->err();
    end(*server);
  }
  std::string file(int part) const {
    return deployment.file(part == 1 ? "out.tum" : "out.part" + std::to_string(part) + ".tum");
  }
  // ATE of a file; for sensors without depth with a scale of its own, metres.
  Evaluation part(int number, bool with_scale) const {
    const Result<Trajectory> estimate = read_trajectory(file(number));
    EXPECT_TRUE(estimate.ok()) << estimate.message();
    if (!estimate.ok()) return {};
    const Result<Evaluation> evaluation = evaluate(truth, *estimate, {.with_scale = with_scale});
    EXPECT_TRUE(evaluation.ok()) << evaluation.message();
    return evaluation.ok() ? *evaluation : Evaluation{};
  }

  Trajectory truth;
  Deployment deployment;
  std::unique_ptr<Process> client;
};

TEST(MonoMap, ALostCameraThatComesBackHasOneTrajectoryInOneScale) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const LostRun run(lost_way(Sensor::kMono, 560));
  EXPECT_EQ(run.client->reported("parts"), 1);
  EXPECT_FALSE(fs::exists(run.file(2)));
  const Evaluation whole = run.part(1, true);
  EXPECT_GT(whole.pairs, 440u);
  EXPECT_EQ(static_cast<double>(whole.pairs), run.client->reported("tracked"));
  EXPECT_LT(whole.ate.rmse, 0.05);
}

class WhoNeverComesBack : public ::testing::TestWithParam<Sensor> {};

TEST_P(WhoNeverComesBack, HasATrajectoryFileForEachPart) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const LostRun run(lost_way(GetParam(), 280));
  const bool mono = GetParam() == Sensor::kMono;
  EXPECT_EQ(run.client->reported("parts"), 2);
  const Evaluation first = run.part(1, mono), second = run.part(2, mono);
  EXPECT_GT(first.pairs, 40u);
  EXPECT_GT(second.pairs, 80u);
  EXPECT_EQ(static_cast<double>(first.pairs + second.pairs), run.client->reported("tracked"));
  EXPECT_LT(first.ate.rmse, 0.05);
  EXPECT_LT(second.ate.rmse, 0.05);
  EXPECT_FALSE(fs::exists(run.file(3)));
  // Nobody should take the first file for all there is.
  for (const std::string& said : {std::string("2 parts of the map were never merged"), run.file(1),
                                  run.file(2), std::to_string(second.pairs) + " frames"})
    EXPECT_NE(run.client->err().find(said), std::string::npos) << said << "\n" << run.client->err();
}

INSTANTIATE_TEST_SUITE_P(Sensors, WhoNeverComesBack,
                         ::testing::Values(Sensor::kMono, Sensor::kRgbd), [](const auto& sensor) {
                           return std::string(sensor.param == Sensor::kMono ? "Mono" : "Rgbd");
                         });

}  // namespace
}  // namespace cairn::testing
