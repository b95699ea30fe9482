// The server as a whole, without clients: what it makes of its map file when it starts and ends.
#include "server/pipeline.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <thread>

#include "client/link/link.h"
#include "common/wire/keyframe_codec.h"
#include "tests/support/loopback.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

const ClientId kClient{"walker", 7};

// A server of its own for each test: its folder, and its corner of DDS.
class PipelineTest : public ::testing::Test {
 protected:
  PipelineTest()
      : folder_(fs::temp_directory_path() /
                ("cairn_pipeline_" + std::to_string(getpid()) + "_" +
                 ::testing::UnitTest::GetInstance()->current_test_info()->name())) {
    fs::create_directories(folder_);
    const auto node = net_.node();
    setenv("CYCLONEDDS_URI", node.config.c_str(), 1);
    config_.domain = node.domain;
    config_.map_file = (folder_ / "map.db").string();
    config_.save_every_s = 86400;
  }
  ~PipelineTest() override { fs::remove_all(folder_); }

  // The file that a server leaves which was killed when it had journaled all keyframes of the
  // world, and had saved the first `saved` of them.
  void leave_file(const SyntheticMap& world, std::size_t saved) {
    auto file = MapFile::open(config_.map_file);
    ASSERT_TRUE(file.ok()) << file.message();
    Map map;
    map.id = {42};
    for (const KeyframePtr& keyframe : world.keyframes) {
      const auto blob = wire::encode_keyframe(kClient.name, *keyframe);
      ASSERT_TRUE((*file)->append(kClient, keyframe->id, *blob).ok());
      if (keyframe->id.sequence < saved)
        apply_keyframe(map, wire::decode_keyframe(*blob)->keyframe);
    }
    if (saved > 0) {
      ASSERT_TRUE((*file)->save_map(map).ok());
    }
  }
  // Null when the server did not start.
  std::unique_ptr<Pipeline> start() {
    auto pipeline = Pipeline::start(config_);
    EXPECT_TRUE(pipeline.ok()) << pipeline.message();
    return pipeline.ok() ? std::move(*pipeline) : nullptr;
  }
  Map saved_map(std::size_t* pending = nullptr) {
    auto file = MapFile::open(config_.map_file);
    EXPECT_TRUE(file.ok()) << file.message();
    auto map = (*file)->load_map();
    EXPECT_TRUE(map.ok() && map->has_value()) << map.message();
    if (pending) *pending = (*file)->pending_keyframes()->size();
    return map.ok() && map->has_value() ? std::move(**map) : Map{};
  }

  std::unique_ptr<Link> connect(const ClientId& client) {
    const auto node = net_.node();
    LinkOptions options;
    options.client = client;
    options.domain = node.domain;
    options.outbox = folder_ / "outbox";
    options.dds_config = node.config;
    auto link = Link::start(options);
    EXPECT_TRUE(link.ok()) << link.message();
    return std::move(*link);
  }
  // Takes updates until so many keyframes are mapped. False after some seconds without one.
  static bool wait_mapped(Link& link, std::uint32_t count) {
    while (const auto update = link.wait_update(std::chrono::seconds(5)))
      if (update->mapped_keyframes >= count) return true;
    return false;
  }
  // Nothing tells the end of a desk: looks again and again, for some seconds. Each state is looked
  // at once: the next may be another.
  static bool wait_state(const Pipeline& pipeline,
                         const std::function<bool(const ServerState&)>& is_reached) {
    for (int i = 0; i < 1000; ++i) {
      if (is_reached(pipeline.state())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }
  static bool wait_desks(const Pipeline& pipeline, std::size_t count) {
    return wait_state(pipeline, [&](const ServerState& state) { return state.desks == count; });
  }

  testing::Loopback net_;
  const fs::path folder_;
  ServerConfig config_;
};

TEST_F(PipelineTest, KeyframesThatWereSavedBeforeTheyWereMappedAreMappedAfterACrash) {
  const SyntheticMap world({.keyframes = 6, .points = 300});
  leave_file(world, 4);
  const std::uint64_t before = saved_map().revision;
  auto pipeline = start();
  ASSERT_TRUE(pipeline);
  ASSERT_TRUE(pipeline->stop().ok());
  EXPECT_EQ(pipeline->state().mapped, 6u);
  pipeline.reset();
  const Map map = saved_map();
  EXPECT_GT(map.revision, before + 2 * 6);
  EXPECT_EQ(map.mapped_of(kClient.epoch), 6u);
}

// Clients that find another map under the same server leave what they had mapped where it was.
TEST_F(PipelineTest, AServerKilledBeforeItsFirstSaveComesBackWithTheSameMap) {
  const auto pipeline = start();
  ASSERT_TRUE(pipeline);
  for (const auto& entry : fs::directory_iterator(folder_))  // as a killed server leaves them
    fs::copy(entry.path(), folder_ / ("left_" + entry.path().filename().string()));
  config_.map_file = (folder_ / "left_map.db").string();
  const auto next = start();
  ASSERT_TRUE(next);
  EXPECT_EQ(next->state().map_id, pipeline->state().map_id);
}

// A port that somebody listens on.
class OccupiedPort {
 public:
  OccupiedPort() : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    bind(socket_, reinterpret_cast<const sockaddr*>(&address), size);
    listen(socket_, 1);
    getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
  }
  ~OccupiedPort() { close(socket_); }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }

 private:
  int socket_;
  std::uint16_t port_ = 0;
};

TEST_F(PipelineTest, AStartThatFailsLeavesTheMapFileAsItWas) {
  const SyntheticMap world({.keyframes = 5, .points = 150});
  leave_file(world, 3);
  const Map before = saved_map();
  const OccupiedPort port;
  config_.http = port.address();
  const auto failed = Pipeline::start(config_);
  ASSERT_FALSE(failed.ok());
  EXPECT_NE(failed.message().find(port.address()), std::string::npos) << failed.message();
  std::size_t pending = 0;
  const Map after = saved_map(&pending);
  EXPECT_EQ(after.revision, before.revision);
  EXPECT_EQ(after.keyframes.sorted_keys(), before.keyframes.sorted_keys());
  EXPECT_EQ(pending, 2u);
}

TEST_F(PipelineTest, AnEndFinishesTheMappingOfALongQueueAndSaves) {
  const SyntheticMap world({.keyframes = 30, .points = 150, .step = 0.2});
  leave_file(world, 0);
  auto pipeline = start();
  ASSERT_TRUE(pipeline);
  ASSERT_TRUE(pipeline->stop().ok());
  EXPECT_EQ(pipeline->state().mapped, 30u);
  EXPECT_EQ(pipeline->state().awaiting_mapping, 0u);
  pipeline.reset();
  std::size_t pending = 0;
  const Map map = saved_map(&pending);
  EXPECT_EQ(pending, 0u);
  EXPECT_EQ(map.keyframes.size() + map.removed_keyframes.size(), 30u);
  EXPECT_TRUE(map.unmapped().empty());
}

TEST_F(PipelineTest, MappingGivesRoomBackToTheClient) {
  const SyntheticMap world({.keyframes = 12, .points = 100});
  config_.queue_capacity = 2;
  const auto pipeline = start();
  ASSERT_TRUE(pipeline);
  const auto link = connect(kClient);
  for (const KeyframePtr& keyframe : world.keyframes) link->send(keyframe);
  EXPECT_TRUE(wait_mapped(*link, 12));
  EXPECT_TRUE(link->wait_delivered(std::chrono::seconds(5)));
}

TEST_F(PipelineTest, WhatIsKeptForAClientGoesWithIt) {
  const SyntheticMap world({.keyframes = 3, .points = 100});
  leave_file(world, 1);
  const auto pipeline = start();
  ASSERT_TRUE(pipeline);
  EXPECT_TRUE(wait_state(*pipeline, [](const ServerState& state) { return state.mapped == 3; }));
  EXPECT_TRUE(wait_desks(*pipeline, 0)) << "of a run that is not there";
  const auto link = connect({"walker", 8});
  ASSERT_TRUE(link->wait_update(std::chrono::seconds(5)));
  EXPECT_TRUE(wait_desks(*pipeline, 1));
  link->stop();
  EXPECT_TRUE(wait_desks(*pipeline, 0));
}

}  // namespace
}  // namespace cairn
