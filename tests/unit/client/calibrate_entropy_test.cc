#include "client/calibrate_entropy.h"

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <unistd.h>

#include <gtest/gtest.h>

namespace cairn {
namespace {

namespace fs = std::filesystem;

class CalibrateEntropy : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() / (std::string("cairn_calibrate_") +
                                     testing::UnitTest::GetInstance()->current_test_info()->name() +
                                     "_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& text) const {
    const fs::path path = folder_ / "client.yaml";
    std::ofstream(path) << text;
    return path.string();
  }
  static std::string read(const std::string& path) {
    std::stringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }

  fs::path folder_;
};

TEST_F(CalibrateEntropy, FindsTheSameMeanAsARunThatFollowsTheSceneOnline) {
  ClientConfig config;
  config.frontend.extractor.entropy.min_threshold = 0;
  const auto found = calibrate_entropy("synth:weak?frames=3", config, {});
  ASSERT_TRUE(found) << found.message();
  EXPECT_EQ(found->frames, 3u);
  EXPECT_GT(found->scene_mean, 1);
  EXPECT_LT(found->scene_mean, 8);
  EXPECT_DOUBLE_EQ(found->threshold, found->scene_mean / 2 + 0.3);
  config.frontend.extractor.entropy.mode = EntropyMode::kOff;  // whatever the mode at the time
  EXPECT_EQ(calibrate_entropy("synth:weak?frames=3", config, {})->scene_mean, found->scene_mean);
}

TEST_F(CalibrateEntropy, SaysWhatIsWrongWithTheInput) {
  EXPECT_FALSE(calibrate_entropy("synth:nowhere", {}, {}));
}

TEST_F(CalibrateEntropy, StoresTheMeanAndLeavesTheRestAlone) {
  const std::string path = write(
      "sensor: rgbd  # as it was\n"
      "\n"
      "frontend:\n"
      "    features: 700\n"
      "    sharpen:\n"
      "        # why\n"
      "        mode: online  # for now\n"
      "        block: 32\n"
      "tracking:\n"
      "  min_inliers: 25\n");
  ASSERT_TRUE(store_scene_mean(path, 4.25));
  EXPECT_EQ(read(path),
            "sensor: rgbd  # as it was\n"
            "\n"
            "frontend:\n"
            "    features: 700\n"
            "    sharpen:\n"
            "        scene_mean: 4.2500\n"
            "        # why\n"
            "        mode: calibrated  # for now\n"
            "        block: 32\n"
            "tracking:\n"
            "  min_inliers: 25\n");
  const auto config = load_client_config(path);
  ASSERT_TRUE(config) << config.message();
  EXPECT_EQ(config->frontend.extractor.entropy.mode, EntropyMode::kCalibrated);
  EXPECT_EQ(config->frontend.extractor.entropy.scene_mean, 4.25);
  EXPECT_EQ(config->frontend.extractor.entropy.block, 32);
  ASSERT_TRUE(store_scene_mean(path, 5.5));  // again
  EXPECT_EQ(load_client_config(path)->frontend.extractor.entropy.scene_mean, 5.5);
}

TEST_F(CalibrateEntropy, MakesTheSectionsThatAreMissing) {
  for (const char* text :
       {"sensor: rgbd\n", "sensor: rgbd", "frontend:\n  features: 700\n\nsensor: rgbd\n",
        "frontend:\n  sharpen:\n    mode: fixed\n    threshold: 2.5\nsensor: rgbd\n"}) {
    const std::string path = write(text);
    const Status stored = store_scene_mean(path, 4.5);
    ASSERT_TRUE(stored) << stored.message();
    const auto config = load_client_config(path);
    ASSERT_TRUE(config) << config.message();
    EXPECT_EQ(config->frontend.extractor.entropy.mode, EntropyMode::kCalibrated) << text;
    EXPECT_EQ(config->frontend.extractor.entropy.scene_mean, 4.5) << text;
  }
}

TEST_F(CalibrateEntropy, LeavesAFileThatItCannotChangeAsItIs) {
  for (const std::string text :
       {"sensor: rgbd\nfrontend: {features: 700}\n",
        "sensor: rgbd\nfrontend:\n  sharpen: {mode: online}\n", "sensor: rgbd\nnonsense: 1\n"}) {
    const std::string path = write(text);
    EXPECT_FALSE(store_scene_mean(path, 4.5)) << text;
    EXPECT_EQ(read(path), text);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);
  }
  EXPECT_FALSE(store_scene_mean((folder_ / "none.yaml").string(), 4.5));
}

}  // namespace
}  // namespace cairn
