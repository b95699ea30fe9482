#include "server/tool/synth_command.h"

#include <algorithm>
#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/model/trajectory.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/tool/run_tool.h"

namespace cairn {
namespace {

using testing::HasSubstr;

Outcome synth(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"synth", "--scene", "textureless"});
  return run_tool({add_synth_command}, std::move(arguments));
}

TEST(SynthCommand, WritesARecordingWithGroundTruthAndConfig) {
  const synthetic::TempFolder folder;
  const std::string out = (folder / "r").string();
  const Outcome outcome = synth({"--out", out, "--frames", "3", "--stereo"});
  EXPECT_EQ(outcome.code, kExitOk) << outcome.err;
  EXPECT_EQ(outcome.out, out + "\n");
  for (const char* name : {"rgb.txt", "right.txt", "client.yaml"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / "r" / name)) << name;
  }
  const auto truth = read_trajectory(out + "/groundtruth.txt");
  ASSERT_TRUE(truth.ok());
  EXPECT_EQ(truth->size(), 3u);
}

TEST(SynthCommand, WritesPosesAloneThatAgreeWithTheRecording) {
  const synthetic::TempFolder folder;
  ASSERT_EQ(synth({"--out", (folder / "r").string(), "--frames", "2"}).code, kExitOk);
  ASSERT_EQ(synth({"--out", (folder / "poses.txt").string(), "--frames", "2", "--poses-only"}).code,
            kExitOk);
  const auto text = [](const std::filesystem::path& file) {
    std::ifstream stream(file);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  EXPECT_EQ(text(folder / "poses.txt"), text(folder / "r/groundtruth.txt"));
}

TEST(SynthCommand, WritesTheEurocLayout) {
  const synthetic::TempFolder folder;
  const std::string out = (folder / "r").string();
  ASSERT_EQ(synth({"--out", out, "--frames", "1", "--mono", "--euroc"}).code, kExitOk);
  EXPECT_TRUE(std::filesystem::exists(folder / "r/mav0/cam0/sensor.yaml"));
  EXPECT_FALSE(std::filesystem::exists(folder / "r/mav0/cam1"));
}

TEST(SynthCommand, SaysOnOneLineWhatIsWrong) {
  const synthetic::TempFolder folder;
  std::ofstream(folder / "here") << "x";
  const Outcome full = synth({"--out", folder.path().string()});
  EXPECT_EQ(full.code, kExitUsage);
  EXPECT_THAT(full.err, HasSubstr("is not empty"));
  EXPECT_EQ(std::count(full.err.begin(), full.err.end(), '\n'), 1);
  EXPECT_EQ(synth({"--out", (folder / "r").string(), "--frames", "-1"}).code, kExitUsage);
  EXPECT_EQ(synth({"--out", (folder / "r").string(), "--euroc"}).code, kExitUsage);
  EXPECT_EQ(synth({"--out", (folder / "here/r").string()}).code, kExitFailure);
  EXPECT_EQ(synth({"--out", "x", "--stereo", "--mono"}).code, kExitUsage);
  EXPECT_EQ(synth({}).code, kExitUsage);
}

}  // namespace
}  // namespace cairn
