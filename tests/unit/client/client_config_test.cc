#include "client/client_config.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::EndsWith;

Result<ClientConfig> load(const std::string& text) {
  const fs::path path =
      fs::temp_directory_path() / ("cairn_client_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(path) << text;
  auto config = load_client_config(path.string());
  fs::remove(path);
  return config;
}

TEST(ClientConfig, EveryFileInTheConfigFolderLoads) {
  int files = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(CAIRN_SOURCE_DIR) / "config")) {
    if (!entry.path().filename().string().starts_with("client_")) continue;
    ++files;
    const auto config = load_client_config(entry.path().string());
    EXPECT_TRUE(config.ok()) << config.message();
  }
  EXPECT_GE(files, 5);
}

TEST(ClientConfig, TheFullyCommentedFileShowsTheDefaults) {
  const auto shown =
      load_client_config((fs::path(CAIRN_SOURCE_DIR) / "config/client_tum_fr1.yaml").string());
  ASSERT_TRUE(shown.ok()) << shown.message();
  const ClientConfig defaults;
  EXPECT_EQ(shown->domain, defaults.domain);
  EXPECT_EQ(shown->partition, defaults.partition);
  const auto &extractor = shown->frontend.extractor, &plain = defaults.frontend.extractor;
  EXPECT_EQ(extractor.features, plain.features);
  EXPECT_EQ(extractor.pyramid, plain.pyramid);
  EXPECT_EQ(extractor.entropy.mode, plain.entropy.mode);
  EXPECT_EQ(extractor.entropy.block, plain.entropy.block);
  EXPECT_EQ(extractor.entropy.delta, plain.entropy.delta);
  EXPECT_EQ(shown->frontend.depth_error_m, defaults.frontend.depth_error_m);
  EXPECT_EQ(shown->frontend.max_depth_m, defaults.frontend.max_depth_m);
  EXPECT_EQ(shown->frontend.max_depth_baselines, defaults.frontend.max_depth_baselines);
  EXPECT_EQ(shown->frontend.threads, defaults.frontend.threads);
  EXPECT_EQ(shown->tracker.min_inliers, defaults.tracker.min_inliers);
  EXPECT_EQ(shown->tracker.min_inliers_after_loss, defaults.tracker.min_inliers_after_loss);
  EXPECT_EQ(shown->tracker.min_start_features, defaults.tracker.min_start_features);
  EXPECT_EQ(shown->tracker.landmarks_per_keyframe, defaults.tracker.landmarks_per_keyframe);
  EXPECT_EQ(shown->tracker.min_new_landmarks, defaults.tracker.min_new_landmarks);
  EXPECT_EQ(shown->tracker.last_frame_radius, defaults.tracker.last_frame_radius);
  EXPECT_EQ(shown->tracker.local_map_radius, defaults.tracker.local_map_radius);
  EXPECT_EQ(shown->tracker.local_keyframes, defaults.tracker.local_keyframes);
  const auto &policy = shown->tracker.keyframes, &usual = defaults.tracker.keyframes;
  EXPECT_EQ(policy.max_frames_between, usual.max_frames_between);
  EXPECT_EQ(policy.min_frames_between, usual.min_frames_between);
  EXPECT_EQ(policy.min_shared, usual.min_shared);
}

TEST(ClientConfig, AnEmptyFileLeavesTheCameraToTheSource) {
  const auto config = load("");
  ASSERT_TRUE(config.ok()) << config.message();
  EXPECT_FALSE(config->camera.has_value());
}

TEST(ClientConfig, WhatDiffersBySensorHoldsForEverySensorWhenGiven) {
  const auto given = load("tracking:\n  keyframe_min_shared: 0.5\n  min_inliers: 30\n");
  ASSERT_TRUE(given.ok()) << given.message();
  EXPECT_EQ(given->tracker.keyframes.min_shared, 0.5);
  EXPECT_EQ(given->tracker.keyframes.min_shared_mono, 0.5);
  EXPECT_EQ(given->tracker.min_inliers, 30);
  EXPECT_EQ(given->tracker.min_inliers_mono, 30);
  const auto left_out = load("{}\n");
  ASSERT_TRUE(left_out.ok()) << left_out.message();
  EXPECT_GT(left_out->tracker.keyframes.min_shared_mono, left_out->tracker.keyframes.min_shared);
  EXPECT_LT(left_out->tracker.min_inliers_mono, left_out->tracker.min_inliers);
}

TEST(ClientConfig, SharpensAsInThePaperWhenAsked) {
  const auto config = load("frontend:\n  sharpen:\n    min_threshold: 4\n    as_in_paper: true\n");
  ASSERT_TRUE(config.ok()) << config.message();
  EXPECT_EQ(config->frontend.extractor.entropy.min_threshold, 0);
  EXPECT_FALSE(config->frontend.extractor.best_first);
  EXPECT_TRUE(config->frontend.extractor.describe_sharpened);
}

TEST(ClientConfig, WrongValuesAndUnknownKeysNameTheirLineAtEveryDepth) {
  EXPECT_THAT(load("doman: 3\n").message(),
              EndsWith(":1: doman: unknown key; did you mean 'domain'?"));
  EXPECT_THAT(load("domain: 3\nlog_level: loud\n").message(),
              EndsWith(":2: log_level: must be one of debug, info, warn, error, off; has 'loud'"));
  EXPECT_THAT(load("frontend:\n  sharpen:\n    dleta: 0.2\n").message(),
              EndsWith(":3: frontend.sharpen.dleta: unknown key; did you mean 'delta'?"));
}

}  // namespace
}  // namespace cairn
