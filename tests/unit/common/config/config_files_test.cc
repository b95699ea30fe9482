// The configuration files that come with Cairn, as far as the camera goes.
#include <filesystem>

#include <gtest/gtest.h>

#include "common/config/camera_config_reader.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

TEST(ConfigFiles, AllAreYamlAndTheirCamerasAreValid) {
  int files = 0, cameras = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(CAIRN_SOURCE_DIR) / "config")) {
    if (entry.path().extension() != ".yaml") continue;
    ++files;
    auto root = load_yaml(entry.path().string());
    ASSERT_TRUE(root.ok()) << root.message();
    if (!root->has("camera")) continue;
    ++cameras;
    const auto config = read_camera_config(*root);
    EXPECT_TRUE(config.ok()) << config.message();
  }
  EXPECT_GE(files, 6);
  EXPECT_GE(cameras, 2);
}

}  // namespace
}  // namespace cairn
