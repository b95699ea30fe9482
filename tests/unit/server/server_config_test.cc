#include "server/server_config.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::EndsWith;

Result<ServerConfig> load(const std::string& text) {
  const fs::path path =
      fs::temp_directory_path() / ("cairn_server_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(path) << text;
  auto config = load_server_config(path.string());
  fs::remove(path);
  return config;
}

TEST(ServerConfig, TheFileInTheConfigFolderShowsTheDefaults) {
  const auto shown =
      load_server_config((fs::path(CAIRN_SOURCE_DIR) / "config/server.yaml").string());
  ASSERT_TRUE(shown.ok()) << shown.message();
  const ServerConfig defaults;
  EXPECT_EQ(shown->domain, defaults.domain);
  EXPECT_EQ(shown->partition, defaults.partition);
  EXPECT_EQ(shown->map_file, defaults.map_file);
  EXPECT_EQ(shown->http, defaults.http);
  EXPECT_EQ(shown->log_level, defaults.log_level);
  EXPECT_EQ(shown->queue_capacity, defaults.queue_capacity);
  EXPECT_EQ(shown->save_every_s, defaults.save_every_s);
  EXPECT_EQ(shown->mapping_threads, defaults.mapping_threads);
  EXPECT_EQ(shown->local_window, defaults.local_window);
  EXPECT_EQ(shown->publish.bytes_per_s, defaults.publish.bytes_per_s);
  EXPECT_EQ(shown->publish.most_saved_bytes, defaults.publish.most_saved_bytes);
}

TEST(ServerConfig, WrongValuesAndUnknownKeysNameTheirLine) {
  EXPECT_TRUE(load("").ok());
  EXPECT_THAT(load("domain: 233\n").message(),
              EndsWith(":1: domain: must be from 0 to 232, is 233"));
  EXPECT_THAT(load("log_level: loud\n").message(),
              EndsWith(":1: log_level: must be one of debug, info, warn, error, off; has 'loud'"));
  EXPECT_FALSE(load("downlink:\n  kilobytes_per_s: 0\n").ok());
  EXPECT_DOUBLE_EQ(load("downlink:\n  kilobytes_per_s: 12.5\n")->publish.bytes_per_s, 12'500);
  EXPECT_THAT(load("mapping:\n  thread: 2\n").message(),
              EndsWith(":2: mapping.thread: unknown key; did you mean 'threads'?"));
}

}  // namespace
}  // namespace cairn
