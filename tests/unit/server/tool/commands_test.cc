// The commands as a user types them: arguments in, exit code and text out.
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "common/model/trajectory.h"
#include "server/storage/map_file.h"
#include "server/tool/eval_command.h"
#include "server/tool/map_command.h"
#include "tests/unit/server/tool/run_tool.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

Outcome run_command(std::vector<std::string> arguments) {
  return run_tool({add_eval_command, add_map_command}, std::move(arguments));
}

class Commands : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("cairn_commands_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  // A square of 1 m, once round in 4 s, at 10 Hz; `size` blows it up.
  std::string write_square(const std::string& name, double size) {
    Trajectory poses;
    for (int i = 0; i < 40; ++i) {
      const double along = i % 10 * 0.1,
                   corners[4][2] = {{along, 0}, {1, along}, {1 - along, 1}, {0, 1 - along}};
      const auto& corner = corners[i / 10];
      poses.push_back({i * 100'000'000LL,
                       {Eigen::Quaterniond::Identity(), {size * corner[0], size * corner[1], 0}}});
    }
    EXPECT_TRUE(write_trajectory(path(name), poses).ok());
    return path(name);
  }

  // A map file with one keyframe that sees one landmark.
  std::string write_map() {
    const KeyframeId id{7, 0};
    const LandmarkId landmark_id{0, 1};
    Rig rig;
    rig.camera = {.fx = 500, .fy = 500, .cx = 320, .cy = 240, .width = 640, .height = 480};
    rig.camera.baseline = 0.075;
    rig.max_depth = 3;
    auto keyframe = std::make_shared<Keyframe>();
    keyframe->id = id;
    keyframe->stamp_ns = 1'500'000'000;
    keyframe->rig = std::make_shared<Rig>(rig);
    keyframe->features.points.push_back({.x = 320, .y = 240});
    keyframe->features.descriptors.push_back({});
    Map map;
    map.id.value = 0xabc;
    map.revision = 1;
    KeyframeNode node;
    node.keyframe = keyframe;
    node.landmarks = {landmark_id};
    map.keyframes.insert(id, node);
    Landmark landmark;
    landmark.id = landmark_id;
    landmark.position = {0, 0, 2};
    landmark.observations = {{id, 0}};
    landmark.reference = id;
    map.landmarks.insert(landmark_id, landmark);
    auto file = MapFile::open(path("map.db"));
    EXPECT_TRUE(file.ok()) << (file.ok() ? "" : file.message());
    const auto saved = (*file)->save_map(map);
    EXPECT_TRUE(saved.ok()) << (saved.ok() ? "" : saved.message());
    return path("map.db");
  }

  // A map of two keyframes of one client, between which two loops were closed; the second one can
  // be undone. The second keyframe came after the first loop.
  std::string write_map_with_loops() {
    const std::string file_path = write_map();
    auto file = MapFile::open(file_path);
    Map map = **(*file)->load_map();
    const KeyframeId first = map.keyframes.sorted_keys()[0];
    LoopEdge edge;
    edge.query = edge.candidate = first;
    edge.inliers = 77;
    map.loops.push_back(edge);
    const Map before = map;
    KeyframeNode node = map.keyframes.at(first);
    auto keyframe = std::make_shared<Keyframe>(*node.keyframe);
    keyframe->id.sequence = first.sequence + 1;
    node.keyframe = keyframe;
    node.parent = first;
    map.keyframes.insert(keyframe->id, node);
    const auto blob = wire::encode_keyframe("anna", *keyframe);
    EXPECT_TRUE((*file)->append({"anna", keyframe->id.epoch}, keyframe->id, *blob).ok());
    edge.query = keyframe->id;
    edge.merges = true;
    map.loops.push_back(edge);
    EXPECT_TRUE((*file)->save_checkpoint(before).ok());
    EXPECT_TRUE((*file)->save_map(map).ok());
    return file_path;
  }

  fs::path folder_;
};

TEST_F(Commands, EvalPrintsATable) {
  const std::string truth = write_square("truth.tum", 1);
  const Outcome outcome = run_command({"eval", truth, truth});
  EXPECT_EQ(outcome.code, kExitOk);
  EXPECT_THAT(outcome.out, HasSubstr("ATE (SE3)             0.0000"));
  EXPECT_THAT(outcome.out, HasSubstr("coverage           100.0 %"));
  EXPECT_EQ(outcome.err, "");
}

TEST_F(Commands, EvalPrintsJsonThatParses) {
  const std::string truth = write_square("truth.tum", 2), estimate = write_square("half.tum", 1);
  const Outcome outcome =
      run_command({"eval", truth, estimate, "--sim3", "--json", "--frames", "80"});
  ASSERT_EQ(outcome.code, kExitOk) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  EXPECT_EQ(json["alignment"], "sim3");
  EXPECT_NEAR(json["scale"].get<double>(), 2, 1e-9);
  EXPECT_NEAR(json["ate_m"]["rmse"].get<double>(), 0, 1e-9);
  EXPECT_EQ(json["pairs"], 40);
  EXPECT_EQ(json["coverage"], 0.5);
}

TEST_F(Commands, EvalFailsWithOneClearLine) {
  const std::string truth = write_square("truth.tum", 1);
  const Outcome absent = run_command({"eval", truth, path("absent.tum")});
  EXPECT_EQ(absent.code, kExitFailure);
  EXPECT_EQ(absent.out, "");
  EXPECT_EQ(absent.err, "cairn: " + path("absent.tum") + ": can't be read; is the path right?\n");
  std::ofstream(path("bad.tum")) << "1 2 3\n";
  EXPECT_THAT(run_command({"eval", truth, path("bad.tum")}).err, HasSubstr("bad.tum:1: expected"));
}

TEST_F(Commands, WrongUsageIsToldFromFailure) {
  EXPECT_EQ(run_command({}).code, kExitUsage);
  EXPECT_EQ(run_command({"eval", "one"}).code, kExitUsage);
  EXPECT_EQ(run_command({"eval", "a", "b", "--max-diff", "-1"}).code, kExitUsage);
  EXPECT_EQ(run_command({"map"}).code, kExitUsage);
  EXPECT_EQ(run_command({"map", "export", "x.db", "--format", "pdf"}).code, kExitUsage);
}

TEST_F(Commands, MapInfoTellsWhatAFileHolds) {
  const Outcome outcome = run_command({"map", "info", write_map()});
  ASSERT_EQ(outcome.code, kExitOk) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("0000000000000abc"));
  EXPECT_THAT(outcome.out, HasSubstr("keyframes    1\n"));
  EXPECT_THAT(outcome.out, HasSubstr("landmarks    1, seen 1.0 times each\n"));
}

TEST_F(Commands, MapInfoListsLoopsAndMerges) {
  const std::string file = write_map_with_loops();
  const Outcome outcome = run_command({"map", "info", file});
  ASSERT_EQ(outcome.code, kExitOk) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("events       2 merges and loops\n"));
  EXPECT_THAT(outcome.out, HasSubstr("  1 loop     keyframe anna 0 to anna 0, 77 inliers\n"));
  EXPECT_THAT(outcome.out,
              HasSubstr("  2 merge    keyframe anna 1 to anna 0, 77 inliers, can be undone\n"));
  const auto json = nlohmann::json::parse(run_command({"map", "info", file, "--json"}).out);
  ASSERT_EQ(json["loops"].size(), 2u);
  EXPECT_EQ(json["loops"][0]["kind"], "loop");
  EXPECT_EQ(json["loops"][0]["can_undo"], false);
  EXPECT_EQ(json["loops"][1]["event"], 2);
  EXPECT_EQ(json["loops"][1]["kind"], "merge");
  EXPECT_EQ(json["loops"][1]["can_undo"], true);
  EXPECT_EQ(json["loops"][1]["query"]["client"], "anna");
  EXPECT_EQ(json["keyframes"], 2);
}

TEST_F(Commands, MapUndoGoesBackToBeforeAnEvent) {
  const std::string file = write_map_with_loops();
  const Outcome outcome = run_command({"map", "undo", file, "2"});
  ASSERT_EQ(outcome.code, kExitOk) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("before event 2: 1 keyframes, 1 landmarks; cairn-server will "
                                     "map 1 later keyframes again\n"));
  EXPECT_THAT(run_command({"map", "info", file}).out, HasSubstr("events       1 merges and loops"));
}

TEST_F(Commands, MapUndoFailsWithOneClearLine) {
  const std::string file = write_map_with_loops();
  const Outcome not_kept = run_command({"map", "undo", file, "1"});
  EXPECT_EQ(not_kept.code, kExitFailure);
  EXPECT_EQ(not_kept.err, "cairn: " + file + ": event 1 cannot be undone; what can be undone: 2\n");
  EXPECT_THAT(run_command({"map", "undo", file, "3"}).err, HasSubstr("no event 3; the map has 2"));
  EXPECT_EQ(run_command({"map", "undo", file, "0"}).code, kExitUsage);
  EXPECT_EQ(run_command({"map", "undo", file}).code, kExitUsage);
  EXPECT_EQ(run_command({"map", "undo", path("absent.db"), "1"}).code, kExitFailure);
  EXPECT_FALSE(fs::exists(path("absent.db")));
  const auto server = MapFile::open(file);
  const Outcome in_use = run_command({"map", "undo", file, "2"});
  EXPECT_EQ(in_use.code, kExitFailure);
  EXPECT_THAT(in_use.err, HasSubstr("in use by another program"));
}

TEST_F(Commands, MapExportWritesTheFileItNames) {
  const std::string map = write_map();
  for (const std::string format : {"tum", "ply", "json", "colmap"}) {
    const std::string out = path("out_" + format);
    const Outcome outcome = run_command({"map", "export", map, "--format", format, "--out", out});
    EXPECT_EQ(outcome.code, kExitOk) << outcome.err;
    EXPECT_EQ(outcome.out, out + "\n");
    EXPECT_TRUE(fs::exists(out)) << format;
  }
  EXPECT_EQ(read_trajectory(path("out_tum"))->size(), 1u);
  std::ifstream json(path("out_json"));
  EXPECT_EQ(nlohmann::json::parse(json)["info"],
            nlohmann::json::parse(run_command({"map", "info", map, "--json"}).out))
      << "the clients' names too";
}

TEST_F(Commands, MapFailsOnWhatIsNoMap) {
  const Outcome absent = run_command({"map", "info", path("absent.db")});
  EXPECT_EQ(absent.code, kExitFailure);
  EXPECT_THAT(absent.err, HasSubstr("absent.db"));
  EXPECT_FALSE(fs::exists(path("absent.db")));
  std::ofstream(path("text.db")) << "this is no map\n";
  EXPECT_EQ(run_command({"map", "info", path("text.db")}).code, kExitFailure);
}

}  // namespace
}  // namespace cairn
