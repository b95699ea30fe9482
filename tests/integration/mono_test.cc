// A single camera: its map has a scale of its own, everything else is held to the truth.
#include <gtest/gtest.h>

#include <csignal>
#include <optional>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"
#include "tests/support/dataset_writer.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

struct MonoRun {
  double frames = 0, tracked = 0;
  std::size_t pairs = 0;
  double ate = 1e9;  // metres, aligned with scale
};

MonoRun evaluate_run(const Process& client, const Trajectory& truth, const std::string& file) {
  MonoRun run{client.reported("frames"), client.reported("tracked"), 0, 1e9};
  const Result<Trajectory> estimate = read_trajectory(file);
  EXPECT_TRUE(estimate.ok()) << estimate.message();
  if (!estimate.ok()) return run;
  const Result<Evaluation> evaluation = evaluate(truth, *estimate, {.with_scale = true});
  EXPECT_TRUE(evaluation.ok()) << evaluation.message();
  if (!evaluation.ok()) return run;
  run.pairs = evaluation->pairs;
  run.ate = evaluation->ate.rmse;
  return run;
}

MonoRun run_lockstep(const std::string& input, const Trajectory& truth, const std::string& config) {
  Deployment deployment;
  const auto server = deployment.server();
  const std::string file = deployment.file("out.tum").string();
  const auto client = deployment.client("eye", input, {"--lockstep", "--trajectory", file},
                                        config.empty() ? "" : deployment.write("c.yaml", config));
  EXPECT_EQ(client->wait(seconds(270)), 0) << client->err();
  EXPECT_EQ(client->reported("keyframes"), client->reported("mapped"));
  server->signal(SIGTERM);
  EXPECT_EQ(server->wait(seconds(30)), 0) << server->err();
  return evaluate_run(*client, truth, file);
}

Trajectory truth_file(const std::filesystem::path& file) {
  const Result<Trajectory> truth = read_trajectory(file.string());
  EXPECT_TRUE(truth.ok()) << truth.message();
  return truth.ok() ? *truth : Trajectory{};
}

MonoRun run_scene(const std::string& scene, int frames) {
  return run_lockstep("synth:" + scene + "?sensor=mono&frames=" + std::to_string(frames),
                      truth_of({.scene = scene, .frames = frames, .sensor = Sensor::kMono}), "");
}

TEST(Mono, DeskIsTrackedWithinACentimetre) {
  const MonoRun run = run_scene("desk", 150);
  EXPECT_EQ(run.tracked, 150);
  EXPECT_EQ(run.pairs, 150u);
  EXPECT_LT(run.ate, 0.01);
}

// A map starts with two keyframes at once, and the server may be quicker or slower with the first.
TEST(Mono, ALockstepRunIsTheSameEveryTime) {
  std::vector<Trajectory> written;
  for (int run = 0; run < 3; ++run) {
    Deployment deployment;
    const auto server = deployment.server();
    const std::string file = deployment.file("out.tum").string();
    const auto client = deployment.client("eye", "synth:desk?sensor=mono&frames=45",
                                          {"--lockstep", "--trajectory", file});
    ASSERT_EQ(client->wait(seconds(120)), 0) << client->err();
    const Result<Trajectory> trajectory = read_trajectory(file);
    ASSERT_TRUE(trajectory) << trajectory.message();
    written.push_back(*trajectory);
  }
  ASSERT_GT(written[0].size(), 30u);
  for (int run = 1; run < 3; ++run) {
    ASSERT_EQ(written[static_cast<std::size_t>(run)].size(), written[0].size());
    for (std::size_t i = 0; i < written[0].size(); ++i)
      ASSERT_EQ(written[static_cast<std::size_t>(run)][i].world_from_camera.matrix(),
                written[0][i].world_from_camera.matrix())
          << "run " << run << ", frame " << i;
  }
}

// Forward along a wall, where the wall's plane has a second explanation.
TEST(Mono, HallIsTrackedWithinFiveCentimetres) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const MonoRun run = run_scene("hall", 200);
  EXPECT_GE(run.tracked, 0.95 * run.frames);
  EXPECT_LT(run.ate, 0.05);
}

TEST(Mono, AWeaklyTexturedRoomIsTrackedWithinFiveCentimetres) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const MonoRun run = run_scene("weak", 200);
  EXPECT_GE(run.tracked, 0.95 * run.frames);
  EXPECT_LT(run.ate, 0.05);
}

TEST(Mono, TracksAloneWithoutAServer) {
  Deployment deployment;
  const std::string file = deployment.file("out.tum").string();
  const auto client = deployment.client("eye", "synth:desk?sensor=mono&frames=100",
                                        {"--no-server", "--max-rate", "--trajectory", file});
  ASSERT_EQ(client->wait(seconds(120)), 3) << client->err();
  const MonoRun run = evaluate_run(
      *client, truth_of({.scene = "desk", .frames = 100, .sensor = Sensor::kMono}), file);
  EXPECT_EQ(run.tracked, 100);
  EXPECT_LT(run.ate, 0.05);
}

// The lens is undistorted by the front end; nothing after it knows.
TEST(Mono, AFisheyeCameraIsTrackedAsWell) {
  Deployment deployment;
  const synthetic::SequenceOptions options{
      .scene = "desk",
      .frames = 90,
      .sensor = Sensor::kMono,
      .camera = Camera(LensModel::kFisheye, 640, 480, {380, 380, 319.5, 239.5},
                       {-0.01, 0.02, -0.01, 0.002})};
  const auto sequence = synthetic::SyntheticSequence::make(options);
  ASSERT_TRUE(sequence.ok());
  const auto folder = deployment.file("fisheye");
  ASSERT_TRUE(synthetic::write_dataset(**sequence, folder, synthetic::DatasetLayout::kTum).ok());
  const auto server = deployment.server();
  const std::string file = deployment.file("out.tum").string();
  const auto client =
      deployment.client("eye", "tum:" + folder.string(), {"--lockstep", "--trajectory", file},
                        (folder / "client.yaml").string());
  ASSERT_EQ(client->wait(seconds(240)), 0) << client->err();
  const MonoRun run = evaluate_run(*client, truth_of(options), file);
  EXPECT_EQ(run.tracked, 90);
  EXPECT_LT(run.ate, 0.02);
}

// Bars: what ORB-SLAM2 reaches on the same images.
TEST(Mono, EurocStartsSoonAndIsTrackedAsWellAsByOrbSlam2) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const auto folder = recording("euroc_v101_mono_90");
  if (!folder) GTEST_SKIP() << "no recording euroc_v101_mono_90; set CAIRN_DATA";
  const MonoRun run = run_lockstep("euroc:" + folder->string(),
                                   truth_file(*folder / "groundtruth_body_tum.txt"), "{}\n");
  EXPECT_EQ(run.tracked, 90) << "those before the start get their poses afterwards";
  EXPECT_LE(run.ate, 0.006);
}

// Bars: what ORB-SLAM2 reaches on the same images. The first recording is next to nothing but fast
// turns.
struct RealMono {
  std::string folder, camera;
  int min_frames;
  double max_ate;  // metres
  friend void PrintTo(const RealMono& r, std::ostream* out) { *out << r.folder; }
};

class RealMonoTest : public ::testing::TestWithParam<RealMono> {};

TEST_P(RealMonoTest, IsTrackedFarEnoughAndTrue) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  const auto folder = recording(GetParam().folder);
  if (!folder) GTEST_SKIP() << "no recording " << GetParam().folder << "; set CAIRN_DATA";
  const MonoRun run = run_lockstep("tum:" + folder->string(),
                                   truth_file(*folder / "groundtruth.txt"), GetParam().camera);
  EXPECT_GE(run.pairs, static_cast<std::size_t>(GetParam().min_frames));
  EXPECT_LE(run.ate, GetParam().max_ate);
}

INSTANTIATE_TEST_SUITE_P(
    Recordings, RealMonoTest,
    ::testing::Values(
        RealMono{"tum_fr1_rpy_240",
                 "sensor: mono\ncamera:\n  resolution: [640, 480]\n"
                 "  intrinsics: [517.306, 516.469, 318.643, 255.314]\n"
                 "  distortion: [0.262383, -0.953104, -0.005358, 0.002628, 1.163314]\n",
                 205, 0.042},
        RealMono{"sevenscenes_kitchen_400",
                 "sensor: mono\ncamera:\n  resolution: [640, 480]\n"
                 "  intrinsics: [585, 585, 320, 240]\n",
                 375, 0.025}),
    [](const auto& recording_info) { return recording_info.param.folder; });

}  // namespace
}  // namespace cairn::testing
