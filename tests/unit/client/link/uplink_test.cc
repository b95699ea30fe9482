// The uplink against a server played by the test: what it sends is recorded, acknowledgements come
// when the test says so.
#include "client/link/uplink.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>

#include "common/wire/keyframe_codec.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using cairn::testing::sample_keyframe_ptr;

const ClientId kClient{"alice", 42};

class UplinkTest : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = std::filesystem::temp_directory_path() /
            ("cairn-uplink-" + std::to_string(getpid()) + "-" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name());
    start();
  }
  void TearDown() override {
    uplink_.reset();
    std::filesystem::remove(path_);
  }

  void start(const ClientId& client = kClient, bool with_server = true) {
    auto outbox = Outbox::open(path_, client.name);
    ASSERT_TRUE(outbox);
    Uplink::Port port;
    if (with_server) {
      port.send_keyframe = [this](const wire::KeyframeMessage& m) { return on_keyframe(m); };
      port.send_state = [this](const wire::ClientStateMessage& m) { return on_state(m); };
    }
    uplink_ = std::make_unique<Uplink>(client, Sensor::kRgbd, std::move(*outbox), port, timing_);
  }
  Status on_keyframe(const wire::KeyframeMessage& m) {
    std::lock_guard lock(mutex_);
    if (full_) return {ErrorCode::kTimeout, "no room"};
    EXPECT_TRUE(wire::decode_keyframe(m.blob));
    sent_.push_back({m.client.epoch, m.sequence});
    oldest_ = m.oldest;
    changed_.notify_all();
    return {};
  }
  Status on_state(const wire::ClientStateMessage& m) {
    std::lock_guard lock(mutex_);
    states_.push_back(m);
    changed_.notify_all();
    return {};
  }
  void send(std::uint32_t first, std::uint32_t count) {
    for (std::uint32_t i = first; i < first + count; ++i)
      uplink_->send(sample_keyframe_ptr({kClient.epoch, i}));
  }
  void ack(std::uint32_t next, std::uint32_t credits = 32, std::uint64_t server = 1,
           std::uint64_t epoch = kClient.epoch) {
    uplink_->on_ack({.client = {kClient.name, epoch},
                     .server = server,
                     .next_sequence = next,
                     .credits = credits,
                     .published_revision = 0,
                     .refusal = {}});
  }
  void refuse() {
    uplink_->on_ack({.client = kClient,
                     .server = 1,
                     .next_sequence = 0,
                     .credits = 0,
                     .published_revision = 0,
                     .refusal = "name in use"});
  }
  template <typename Predicate>
  bool wait(Predicate&& predicate, std::chrono::milliseconds timeout = 5000ms) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, timeout, predicate);
  }
  bool wait_sent(std::size_t count, std::chrono::milliseconds timeout = 5000ms) {
    return wait([&] { return sent_.size() >= count; }, timeout);
  }

  Uplink::Timing timing_{.heartbeat = 50ms,
                         .resend = 10s,
                         .resend_most = 10s,
                         .retry = 5ms,
                         .silence = 10s,
                         .refusal_patience = 100ms};
  std::filesystem::path path_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<KeyframeId> sent_;
  std::vector<wire::ClientStateMessage> states_;
  std::uint32_t oldest_ = 0;
  bool full_ = false;
  std::unique_ptr<Uplink> uplink_;
};

TEST_F(UplinkTest, SendsNothingBeforeTheServerHasAnswered) {
  send(0, 3);
  EXPECT_TRUE(wait([&] { return states_.size() >= 2; }));  // but says hello, again and again
  EXPECT_TRUE(sent_.empty());
  EXPECT_FALSE(uplink_->stats().connected);
  ack(0);
  EXPECT_TRUE(wait_sent(3));
  EXPECT_TRUE(uplink_->stats().connected);
}

TEST_F(UplinkTest, SendsNoMoreThanTheCreditsAllow) {
  ack(0, 2);
  send(0, 10);
  ASSERT_TRUE(wait_sent(2));
  EXPECT_FALSE(wait_sent(3, 50ms));
  ack(1, 2);
  ASSERT_TRUE(wait_sent(3));
  ack(3, 0);
  EXPECT_FALSE(wait_sent(4, 50ms));
  ack(3, 7);
  ASSERT_TRUE(wait_sent(10));
  EXPECT_EQ(oldest_, 3u);
}

TEST_F(UplinkTest, DeliveredWhenAllIsAcknowledged) {
  ack(0);
  send(0, 3);
  ASSERT_TRUE(wait_sent(3));
  EXPECT_FALSE(uplink_->wait_delivered(10ms));
  ack(3);
  EXPECT_TRUE(uplink_->wait_delivered(5s));
  EXPECT_EQ(uplink_->stats().acked, 3u);
  uplink_->stop();
  EXPECT_FALSE(std::filesystem::exists(path_));
  EXPECT_TRUE(states_.back().leaving);
}

TEST_F(UplinkTest, SendsAgainWhenAcknowledgementsStayAway) {
  uplink_.reset();
  timing_.resend = 300ms;
  start();
  ack(0);
  send(0, 2);
  const auto times_sent = [&](std::uint32_t sequence) {
    return std::count(sent_.begin(), sent_.end(), KeyframeId{kClient.epoch, sequence});
  };
  EXPECT_TRUE(wait([&] { return times_sent(0) >= 2 && times_sent(1) >= 2; }));
  EXPECT_GE(uplink_->stats().resends, 1u);
}

TEST_F(UplinkTest, SendsAgainToAServerThatHasBeenRestarted) {
  ack(0);
  send(0, 2);
  ASSERT_TRUE(wait_sent(2));
  ack(1, 32, /*server=*/2);
  ASSERT_TRUE(wait_sent(3));
  EXPECT_EQ(sent_[2], (KeyframeId{kClient.epoch, 1}));
}

TEST_F(UplinkTest, RepeatedAndOldAcknowledgementsDoNoHarm) {
  ack(0);
  send(0, 3);
  ASSERT_TRUE(wait_sent(3));
  ack(2);
  ack(1);
  ack(2);
  EXPECT_FALSE(uplink_->wait_delivered(30ms));
  EXPECT_EQ(uplink_->stats().waiting, 1u);
  EXPECT_EQ(uplink_->stats().acked, 2u);
  EXPECT_EQ(sent_.size(), 3u);
}

TEST_F(UplinkTest, TriesAgainWhenThereIsNoRoom) {
  full_ = true;
  ack(0);
  send(0, 2);
  EXPECT_FALSE(wait_sent(1, 50ms));
  {
    std::lock_guard lock(mutex_);
    full_ = false;
  }
  EXPECT_TRUE(wait_sent(2));
}

TEST_F(UplinkTest, FormerRunsAreDeliveredFirst) {
  send(0, 2);
  uplink_.reset();
  start({kClient.name, 43});
  uplink_->send(sample_keyframe_ptr({43, 0}));
  ack(0, 32, 1, 43);
  ASSERT_TRUE(wait_sent(2));
  EXPECT_FALSE(wait_sent(3, 50ms));
  ack(2, 32, 1, 42);
  ASSERT_TRUE(wait_sent(3));
  EXPECT_EQ(sent_, (std::vector<KeyframeId>{{42, 0}, {42, 1}, {43, 0}}));
  ack(1, 32, 1, 43);
  EXPECT_TRUE(uplink_->wait_delivered(5s));
}

TEST_F(UplinkTest, LastingRefusalIsAnErrorButKeyframesAreKept) {
  refuse();
  send(0, 1);
  EXPECT_FALSE(uplink_->wait_delivered(20ms));
  EXPECT_TRUE(uplink_->status());
  // Again and again, as a server does.
  for (int i = 0; i < 200 && uplink_->status(); ++i) {
    refuse();
    EXPECT_FALSE(uplink_->wait_delivered(20ms));
  }
  ASSERT_FALSE(uplink_->status());
  EXPECT_NE(uplink_->status().message().find("name in use"), std::string::npos);
  send(1, 1);
  uplink_->stop();
  EXPECT_EQ((*Outbox::open(path_, kClient.name))->waiting().size(), 2u);
}

TEST_F(UplinkTest, RefreshRequestsAreCounted) {
  uplink_->request_refresh();
  EXPECT_TRUE(wait([&] { return !states_.empty() && states_.back().refresh_requests == 1; }));
  uplink_->request_refresh();
  EXPECT_TRUE(wait([&] { return states_.back().refresh_requests == 2; }));
}

TEST_F(UplinkTest, WithoutServerItOnlyFillsTheOutbox) {
  uplink_.reset();
  start(kClient, /*with_server=*/false);
  send(0, 5);
  EXPECT_FALSE(uplink_->wait_delivered(10s));  // at once
  uplink_->stop();
  EXPECT_EQ(uplink_->stats().waiting, 5u);
  EXPECT_EQ((*Outbox::open(path_, kClient.name))->waiting().size(), 5u);
}

TEST_F(UplinkTest, UnusableKeyframeIsAnErrorAndLeavesNoGap) {
  auto bad = std::make_shared<Keyframe>(*sample_keyframe_ptr({kClient.epoch, 0}));
  bad->odom_from_camera.translation.x() = std::nan("");
  uplink_->send(bad);
  send(1, 1);
  EXPECT_FALSE(uplink_->wait_delivered(5s));
  EXPECT_FALSE(uplink_->status());
  uplink_->stop();
  EXPECT_TRUE((*Outbox::open(path_, kClient.name))->waiting().empty());
}

TEST_F(UplinkTest, TellsWhenTheServerAnsweredLast) {
  using Clock = std::chrono::steady_clock;
  EXPECT_EQ(uplink_->stats().heard, Clock::time_point{});
  const auto before = Clock::now();
  ack(0);
  send(0, 1);
  ASSERT_TRUE(wait_sent(1));
  const auto heard = uplink_->stats().heard;
  EXPECT_GE(heard, before);
  EXPECT_LE(heard, Clock::now());
  refuse();
  wait([] { return false; }, 20ms);
  EXPECT_EQ(uplink_->stats().heard, heard) << "a refusal is no answer to wait for";
}

TEST_F(UplinkTest, WaitingForDeliveryEndsAtAStop) {
  send(0, 1);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(uplink_->wait_delivered(1h, stop.get_token()));
}

}  // namespace
}  // namespace cairn
