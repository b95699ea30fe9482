#include "server/ingest/keyframe_queue.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <thread>

#include "tests/support/memory_journal.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using cairn::testing::MemoryJournal;
using cairn::testing::sample_keyframe_ptr;
using Arrival = KeyframeQueue::Arrival;

const ClientId kAlice{"alice", 1}, kBob{"bob", 2};

class KeyframeQueueTest : public ::testing::Test {
 protected:
  Arrival offer(const ClientId& client, std::uint32_t sequence, std::uint32_t oldest = 0) {
    return queue_.offer(client, oldest, sample_keyframe_ptr({client.epoch, sequence}, 0),
                        wire::Blob{1, 2, 3});
  }
  void take_one() { queue_.done(queue_.next({})->client); }
  // "alice 0", "bob 1" and so on, until the queue is empty.
  std::vector<std::string> take_all() {
    std::vector<std::string> taken;
    while (queue_.queued() > 0) {
      const auto incoming = queue_.next({});
      taken.push_back(incoming->client.name + " " +
                      std::to_string(incoming->keyframe->id.sequence));
      queue_.done(incoming->client);
    }
    return taken;
  }

  MemoryJournal journal_;
  int room_calls_ = 0;
  KeyframeQueue queue_{journal_, 4, [this] { ++room_calls_; }};
};

TEST_F(KeyframeQueueTest, EarlyOnesWaitForThoseBefore) {
  EXPECT_EQ(offer(kAlice, 2), Arrival::kEarly);
  EXPECT_EQ(offer(kAlice, 1), Arrival::kEarly);
  EXPECT_EQ(queue_.queued(), 0u);
  EXPECT_TRUE(journal_.sequences(kAlice).empty());
  EXPECT_EQ(offer(kAlice, 0), Arrival::kAccepted);
  EXPECT_EQ(take_all(), (std::vector<std::string>{"alice 0", "alice 1", "alice 2"}));
  EXPECT_EQ(queue_.window(kAlice).next_sequence, 3u);
}

TEST_F(KeyframeQueueTest, RepeatedOnesAreTakenOnce) {
  EXPECT_EQ(offer(kAlice, 0), Arrival::kAccepted);
  EXPECT_EQ(offer(kAlice, 0), Arrival::kDuplicate);
  EXPECT_EQ(offer(kAlice, 2), Arrival::kEarly);
  EXPECT_EQ(offer(kAlice, 2), Arrival::kDuplicate);
  EXPECT_EQ(offer(kAlice, 1), Arrival::kAccepted);
  EXPECT_EQ(offer(kAlice, 2), Arrival::kDuplicate);
  EXPECT_EQ(journal_.sequences(kAlice), (std::vector<std::uint32_t>{0, 1, 2}));
}

TEST_F(KeyframeQueueTest, AnyOrderWithRepeatsComesOutInOrderOnce) {
  std::mt19937 random(7);
  std::vector<std::string> expected, taken;
  for (std::uint32_t i = 0; i < 40; ++i) expected.push_back("alice " + std::to_string(i));
  while (taken.size() < 40) {
    const auto window = queue_.window(kAlice);
    std::vector<std::uint32_t> flight;
    for (std::uint32_t i = 0; i < window.credits; ++i) {
      const std::uint32_t sequence = window.next_sequence + i;
      if (sequence >= 40) break;
      if (random() % 4 != 0) flight.push_back(sequence);  // some get lost
      if (random() % 3 == 0) flight.push_back(sequence);  // some come twice
    }
    std::shuffle(flight.begin(), flight.end(), random);
    for (const std::uint32_t sequence : flight)
      EXPECT_NE(offer(kAlice, sequence), Arrival::kBeyond);
    for (auto& name : take_all()) taken.push_back(std::move(name));
  }
  EXPECT_EQ(taken, expected);
}

TEST_F(KeyframeQueueTest, CreditsAreTheRoomLeft) {
  EXPECT_EQ(queue_.window(kAlice).credits, 4u);
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_EQ(offer(kAlice, i), Arrival::kAccepted);
  EXPECT_EQ(queue_.window(kAlice).credits, 0u);
  EXPECT_EQ(offer(kAlice, 4), Arrival::kBeyond);
  EXPECT_EQ(journal_.sequences(kAlice).size(), 4u);
  take_one();
  EXPECT_EQ(queue_.window(kAlice).credits, 1u);
  EXPECT_EQ(offer(kAlice, 5), Arrival::kBeyond);
  EXPECT_EQ(offer(kAlice, 4), Arrival::kAccepted);
}

TEST_F(KeyframeQueueTest, TellsWhenARunThatWasFullHasRoomAgain) {
  for (std::uint32_t i = 0; i < 4; ++i) offer(kAlice, i);
  (void)queue_.window(kAlice);
  take_one();
  take_one();
  EXPECT_EQ(room_calls_, 0);
  take_one();
  EXPECT_EQ(room_calls_, 1);
  take_one();
  EXPECT_EQ(room_calls_, 1);
}

TEST_F(KeyframeQueueTest, WhatIsHandedOutTakesRoomUntilItIsDone) {
  for (std::uint32_t i = 0; i < 4; ++i) offer(kAlice, i);
  for (int i = 0; i < 4; ++i) (void)queue_.next({});
  EXPECT_EQ(queue_.queued(kAlice), 4u);
  EXPECT_EQ(queue_.window(kAlice).credits, 0u);
  EXPECT_EQ(offer(kAlice, 4), Arrival::kBeyond);
  EXPECT_EQ(queue_.window(kBob).credits, 4u) << "the others have room of their own";
  EXPECT_EQ(room_calls_, 0);
  for (int i = 0; i < 4; ++i) queue_.done(kAlice);
  EXPECT_EQ(room_calls_, 1);
  EXPECT_EQ(queue_.window(kAlice).credits, 4u);
  queue_.done(kAlice);  // of one that did not come through here
  EXPECT_EQ(queue_.window(kAlice).credits, 4u);
}

TEST_F(KeyframeQueueTest, ARunThatComesBackStillHasToWaitForItsWork) {
  for (std::uint32_t i = 0; i < 4; ++i) offer(kAlice, i);
  for (int i = 0; i < 4; ++i) (void)queue_.next({});
  queue_.forget(kAlice);
  EXPECT_EQ(queue_.window(kAlice).credits, 0u);
  queue_.forget(kAlice);
  for (int i = 0; i < 4; ++i) queue_.done(kAlice);
  EXPECT_EQ(queue_.window(kAlice).credits, 4u);
}

TEST_F(KeyframeQueueTest, ClientsAreServedInTurn) {
  for (std::uint32_t i = 0; i < 3; ++i) offer(kAlice, i);
  for (std::uint32_t i = 0; i < 2; ++i) offer(kBob, i);
  EXPECT_EQ(take_all(),
            (std::vector<std::string>{"alice 0", "bob 0", "alice 1", "bob 1", "alice 2"}));
}

TEST_F(KeyframeQueueTest, GoesOnWhereTheJournalEnds) {
  ASSERT_TRUE(journal_.append(kAlice, {1, 0}, {}));
  ASSERT_TRUE(journal_.append(kAlice, {1, 1}, {}));
  EXPECT_EQ(queue_.window(kAlice).next_sequence, 2u);
  EXPECT_EQ(offer(kAlice, 1), Arrival::kDuplicate);
  EXPECT_EQ(offer(kAlice, 2), Arrival::kAccepted);
}

TEST_F(KeyframeQueueTest, DoesNotWaitForWhatTheClientNoLongerHas) {
  EXPECT_EQ(offer(kAlice, 8, /*oldest=*/7), Arrival::kEarly);
  EXPECT_EQ(offer(kAlice, 7, 7), Arrival::kAccepted);
  EXPECT_EQ(take_all(), (std::vector<std::string>{"alice 7", "alice 8"}));
}

TEST_F(KeyframeQueueTest, WhatTheJournalDidNotTakeComesAgain) {
  EXPECT_EQ(offer(kAlice, 1), Arrival::kEarly);
  journal_.broken = true;
  EXPECT_EQ(offer(kAlice, 0), Arrival::kNotJournaled);
  EXPECT_EQ(queue_.queued(), 0u);
  journal_.broken = false;
  EXPECT_EQ(offer(kAlice, 0), Arrival::kAccepted);
  EXPECT_EQ(queue_.window(kAlice).next_sequence, 2u);
  EXPECT_EQ(queue_.journal_failures(), 1u);
}

TEST_F(KeyframeQueueTest, EndOfARunKeepsWhatIsJournaled) {
  offer(kAlice, 0);
  offer(kAlice, 2);
  queue_.forget(kAlice);
  EXPECT_EQ(take_all(), (std::vector<std::string>{"alice 0"}));
  EXPECT_EQ(queue_.window(kAlice).next_sequence, 1u);  // from the journal
}

TEST_F(KeyframeQueueTest, ClosingEndsTheWaitOnceAllIsHandedOut) {
  offer(kAlice, 0);
  queue_.close();
  EXPECT_TRUE(queue_.next({}));
  EXPECT_FALSE(queue_.next({}));
}

TEST_F(KeyframeQueueTest, StopEndsTheWait) {
  std::stop_source stop;
  std::jthread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(queue_.next(stop.get_token()));
}

}  // namespace
}  // namespace cairn
