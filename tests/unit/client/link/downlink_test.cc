#include "client/link/downlink.h"

#include <gtest/gtest.h>

#include "common/wire/map_update_codec.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using cairn::testing::sample_update;

const ClientId kClient{"alice", 42};

class DownlinkTest : public ::testing::Test {
 protected:
  void receive(std::uint64_t base, std::uint64_t revision, bool last = true,
               std::uint64_t server = 1) {
    MapUpdate update = sample_update(kClient.epoch, 3);
    update.base_revision = base;
    update.revision = revision;
    for (auto& l : update.landmarks) l.id = {0, 10 * revision + l.id.number};
    update.keyframes.clear();
    update.removed_keyframes.clear();
    update.removed_landmarks.clear();
    const auto blob = wire::encode_map_update(kClient.name, update);
    ASSERT_TRUE(blob) << blob.message();
    receive_blob(base, revision, *blob, last, server);
  }
  void receive_blob(std::uint64_t base, std::uint64_t revision, wire::Bytes blob, bool last = true,
                    std::uint64_t server = 1) {
    downlink_.receive({.client = kClient,
                       .server = server,
                       .base_revision = base,
                       .revision = revision,
                       .last_part = last,
                       .blob = blob});
  }
  void ack(std::uint64_t published, std::chrono::seconds at) {
    downlink_.on_ack({.client = kClient,
                      .server = 1,
                      .next_sequence = 0,
                      .credits = 1,
                      .published_revision = published,
                      .refusal = {}},
                     start_ + at);
  }
  // Revisions of the updates that tracking would get now.
  std::vector<std::uint64_t> poll_all() {
    std::vector<std::uint64_t> revisions;
    while (auto update = downlink_.poll()) revisions.push_back(update->revision);
    return revisions;
  }

  Downlink::Clock::time_point start_ = Downlink::Clock::now();
  int asked_ = 0;
  Downlink downlink_{kClient, [this] { ++asked_; }};
};

TEST_F(DownlinkTest, HandsOverAChainOfUpdates) {
  receive(0, 2);
  receive(2, 3);
  receive(3, 4);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{2, 3, 4}));
  EXPECT_EQ(asked_, 0);
}

TEST_F(DownlinkTest, JoinsPartsAndHandsOverNoneAlone) {
  receive(0, 2, /*last=*/false);
  receive(2, 3, false);
  EXPECT_FALSE(downlink_.poll());
  receive(3, 4, true);
  const auto update = downlink_.poll();
  ASSERT_TRUE(update);
  EXPECT_TRUE(update->is_refresh());
  EXPECT_EQ(update->revision, 4u);
  EXPECT_EQ(update->landmarks.size(), 9u);
}

TEST_F(DownlinkTest, GapAsksOnceAndOnlyAFullRefreshHeals) {
  receive(0, 2);
  receive(3, 4);
  receive(4, 5);
  EXPECT_EQ(asked_, 1);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{2}));
  receive(0, 6);
  receive(6, 7);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{6, 7}));
}

TEST_F(DownlinkTest, LostPartVoidsTheWholeUpdate) {
  receive(0, 2, false);
  receive(3, 4, true);
  EXPECT_FALSE(downlink_.poll());
  EXPECT_EQ(asked_, 1);
}

TEST_F(DownlinkTest, RepeatedUpdatesAreIgnoredEvenOldRefreshes) {
  receive(0, 2);
  receive(2, 3);
  receive(0, 2);
  receive(2, 3);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{2, 3}));
  EXPECT_EQ(asked_, 0);
}

TEST_F(DownlinkTest, RestartedServerCountsFromTheBeginning) {
  receive(0, 20);
  receive(0, 2, true, /*server=*/9);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{20, 2}));
}

TEST_F(DownlinkTest, DamagedUpdateIsNotHandedOver) {
  receive(0, 2);
  receive_blob(2, 3, wire::Blob(50, 7));
  EXPECT_EQ(asked_, 1);
  EXPECT_EQ(downlink_.stats().malformed, 1u);
  EXPECT_EQ(poll_all(), (std::vector<std::uint64_t>{2}));
}

TEST_F(DownlinkTest, UpdateThatNeverCameIsNoticedByTheAcknowledgements) {
  receive(0, 2);
  ack(2, 0s);
  ack(3, 1s);
  EXPECT_EQ(asked_, 0);
  ack(3, 5s);
  EXPECT_EQ(asked_, 1);
  ack(3, 6s);
  EXPECT_EQ(asked_, 1);
  ack(3, 9s);  // the request or its answer was lost too
  EXPECT_EQ(asked_, 2);
  receive(0, 4);
  ack(4, 20s);
  EXPECT_EQ(asked_, 2);
}

TEST_F(DownlinkTest, TrackingThatStopsTakingGetsARefreshLater) {
  receive(0, 1);
  for (std::uint64_t r = 1; r <= 400; ++r) receive(r, r + 1);
  EXPECT_EQ(asked_, 1);
  EXPECT_LE(poll_all().size(), 256u);
}

TEST_F(DownlinkTest, WaitingEndsAtTheTimeout) {
  EXPECT_FALSE(downlink_.wait(10ms));
  receive(0, 2);
  EXPECT_TRUE(downlink_.wait(10s));
}

TEST_F(DownlinkTest, WaitingEndsAtAStop) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(downlink_.wait(1h, stop.get_token()));
}

}  // namespace
}  // namespace cairn
