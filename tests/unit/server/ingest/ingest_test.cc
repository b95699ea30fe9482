// Client and server over real sockets on the loopback interface, inside one process.
#include "server/ingest/ingest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <thread>

#include "client/link/link.h"
#include "tests/support/loopback.h"
#include "tests/support/memory_journal.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;
using cairn::testing::Loopback;
using cairn::testing::MemoryJournal;
using cairn::testing::sample_keyframe_ptr;
using cairn::testing::sample_update;

constexpr std::uint64_t kEpoch = 0x1234567890abcdef;

std::vector<std::uint32_t> up_to(std::uint32_t count) {
  std::vector<std::uint32_t> numbers(count);
  for (std::uint32_t i = 0; i < count; ++i) numbers[i] = i;
  return numbers;
}

class IngestTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("cairn-ingest-" + std::to_string(getpid()) + "-" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::unique_ptr<Ingest> serve(std::uint32_t capacity = 32) {
    const auto node = net_.node();
    auto ingest = Ingest::start({.domain = node.domain,
                                 .partition = "cairn",
                                 .queue_capacity = capacity,
                                 .map = {1},
                                 .forget_after = forget_after_,
                                 .on_event = [this](const ClientEvent& e) { note(e); },
                                 .on_question =
                                     [this](const ClientId& client, KeyframePtr view) {
                                       std::lock_guard lock(mutex_);
                                       questions_.emplace_back(client, std::move(view));
                                       changed_.notify_all();
                                     },
                                 .dds_config = node.config},
                                journal_);
    EXPECT_TRUE(ingest) << (ingest ? "" : ingest.message());
    return std::move(*ingest);
  }
  std::unique_ptr<Link> connect(const std::string& name = "alice", std::uint64_t epoch = kEpoch,
                                const std::string& file = "") {
    const auto node = net_.node();
    client_domain_ = node.domain;
    LinkOptions options;
    options.client = {name, epoch};
    options.domain = node.domain;
    options.outbox = outbox(file.empty() ? name : file);
    options.dds_config = node.config;
    auto link = Link::start(options);
    EXPECT_TRUE(link) << (link ? "" : link.message());
    return std::move(*link);
  }
  std::filesystem::path outbox(const std::string& name) const {
    return folder_ / (name + ".outbox");
  }

  void note(const ClientEvent& event) {
    std::lock_guard lock(mutex_);
    events_.push_back(event);
    changed_.notify_all();
  }
  void forget_events() {
    std::lock_guard lock(mutex_);
    events_.clear();
  }
  bool wait_event(ClientEvent::Kind kind, const std::string& name = "alice") {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, 5s, [&] {
      for (const auto& e : events_)
        if (e.kind == kind && e.client.name == name) return true;
      return false;
    });
  }
  // The latest question, once it is the one of that number.
  KeyframePtr wait_question(std::uint32_t number) {
    std::unique_lock lock(mutex_);
    const bool came = changed_.wait_for(lock, 5s, [&] {
      return !questions_.empty() && questions_.back().second->id.sequence == number;
    });
    return came ? questions_.back().second : nullptr;
  }
  static std::vector<std::uint32_t> take(Ingest& ingest, std::uint32_t count) {
    std::stop_source stop;
    std::jthread watchdog([&](std::stop_token done) {
      std::mutex m;
      std::condition_variable_any cv;
      std::unique_lock lock(m);
      cv.wait_for(lock, done, 10s, [] { return false; });
      stop.request_stop();
    });
    std::vector<std::uint32_t> sequences;
    while (sequences.size() < count) {
      const auto incoming = ingest.next(stop.get_token());
      if (!incoming) break;
      sequences.push_back(incoming->keyframe->id.sequence);
      ingest.done(incoming->client);
    }
    return sequences;
  }

  Loopback net_;
  std::chrono::milliseconds forget_after_ = 600s;
  std::uint32_t client_domain_ = 0;  // of the link that was made last
  MemoryJournal journal_;
  std::filesystem::path folder_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<ClientEvent> events_;
  std::vector<std::pair<ClientId, KeyframePtr>> questions_;
};

// A view to be found in the map: nothing is known of it but what it shows.
KeyframePtr sample_view(std::uint32_t number, std::size_t features = 1000) {
  auto view =
      std::make_shared<Keyframe>(cairn::testing::sample_keyframe({kEpoch, number}, features));
  view->reference = {};
  view->reference_from_camera = {};
  view->odom_from_camera = {};
  view->matches.clear();
  return view;
}

TEST_F(IngestTest, QuestionsReachTheServerAndAnswersTheClientThatAsked) {
  auto ingest = serve();
  auto link = connect();
  auto other = connect("bob", 77);
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined, "bob"));
  link->ask(sample_view(4));
  const KeyframePtr view = wait_question(4);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->features.size(), 1000u);
  EXPECT_EQ(ingest->stats().questions, 1u);

  RelocaliseAnswer answer = cairn::testing::sample_answer(kEpoch, 500);
  answer.number = 4;
  ASSERT_TRUE(ingest->answer({"alice", kEpoch}, answer));
  const auto got = link->wait_answer(5s);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->number, 4u);
  EXPECT_EQ(got->around.landmarks.size(), 500u);
  EXPECT_FALSE(link->poll_answer()) << "an answer is taken once";
  EXPECT_FALSE(other->poll_answer());
  EXPECT_EQ(link->stats().questions, 1u);
  EXPECT_GT(link->stats().bytes_up, 40'000u);
  EXPECT_EQ(ingest->answer({"nobody", 5}, answer).error().code, ErrorCode::kNotFound);
}

// Who is cut off asks again and again; what is heard in the end is the latest question alone.
TEST_F(IngestTest, QuestionsDoNotPileUp) {
  auto ingest = serve();
  auto link = connect();
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  auto cable = dds::Participant::create({client_domain_, ""});
  ASSERT_TRUE(cable);
  ASSERT_TRUE((*cable)->set_cut(true));
  for (std::uint32_t number = 1; number <= 20; ++number) {
    link->ask(sample_view(number, 300));
    std::this_thread::sleep_for(5ms);
  }
  ASSERT_TRUE((*cable)->set_cut(false));
  ASSERT_TRUE(wait_question(20));
  EXPECT_LE(ingest->stats().questions, 2u);
}

TEST_F(IngestTest, KeyframesArriveInOrderAndLeaveTheOutbox) {
  auto ingest = serve();
  auto link = connect();
  for (std::uint32_t i = 0; i < 50; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  EXPECT_EQ(take(*ingest, 50), up_to(50));
  EXPECT_TRUE(link->wait_delivered(5s));
  EXPECT_TRUE(link->stats().connected);
  EXPECT_EQ(link->stats().keyframes_acked, 50u);
  EXPECT_EQ(journal_.sequences({"alice", kEpoch}), up_to(50));
  link->stop();
  EXPECT_FALSE(std::filesystem::exists(outbox("alice")));
  EXPECT_TRUE(wait_event(ClientEvent::Kind::kLeft));
}

TEST_F(IngestTest, UpdatesReachTheClientWholeAndInOrder) {
  auto ingest = serve();
  auto link = connect();
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  MapUpdate refresh = sample_update(kEpoch, 3000);
  refresh.base_revision = 0;
  ASSERT_TRUE(ingest->publish({"alice", kEpoch}, refresh));
  const MapUpdate change = sample_update(kEpoch, 10, 2);
  ASSERT_TRUE(ingest->publish({"alice", kEpoch}, change));
  const auto first = link->wait_update(5s);
  ASSERT_TRUE(first);
  EXPECT_TRUE(first->is_refresh());
  EXPECT_EQ(first->landmarks.size(), 3000u);
  const auto second = link->wait_update(5s);
  ASSERT_TRUE(second);
  EXPECT_EQ(second->base_revision, first->revision);
  EXPECT_EQ(second->landmarks.size(), 10u);
  EXPECT_EQ(link->stats().refreshes_asked, 0u);
}

TEST_F(IngestTest, ClientThatMissedTheBeginningAsksForARefresh) {
  auto ingest = serve();
  auto link = connect();
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  ASSERT_TRUE(ingest->publish({"alice", kEpoch}, sample_update(kEpoch)));
  EXPECT_TRUE(wait_event(ClientEvent::Kind::kRefresh));
  EXPECT_FALSE(link->poll_update());
}

TEST_F(IngestTest, UpdatesForAnUnknownClientAreRefused) {
  auto ingest = serve();
  const Status s = ingest->publish({"nobody", 5}, sample_update(5));
  ASSERT_FALSE(s);
  EXPECT_EQ(s.error().code, ErrorCode::kNotFound);
}

TEST_F(IngestTest, SlowConsumerHoldsTheClientBackAndLosesNothing) {
  auto ingest = serve(/*capacity=*/4);
  auto link = connect();
  for (std::uint32_t i = 0; i < 30; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  EXPECT_FALSE(link->wait_delivered(400ms));
  EXPECT_LE(ingest->stats().queued, 4u);
  EXPECT_EQ(take(*ingest, 30), up_to(30));
  EXPECT_TRUE(link->wait_delivered(5s));
}

TEST_F(IngestTest, UnfinishedWorkHoldsTheClientBackAndLosesNothing) {
  auto ingest = serve(/*capacity=*/4);
  auto link = connect();
  for (std::uint32_t i = 0; i < 12; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  for (std::uint32_t i = 0; i < 4; ++i) ASSERT_EQ(ingest->next()->keyframe->id.sequence, i);
  EXPECT_FALSE(link->wait_delivered(400ms));
  EXPECT_EQ(ingest->stats().accepted, 4u) << "the rest waits in the outbox";
  for (int i = 0; i < 4; ++i) ingest->done({"alice", kEpoch});
  EXPECT_EQ(take(*ingest, 8), (std::vector<std::uint32_t>{4, 5, 6, 7, 8, 9, 10, 11}));
  EXPECT_TRUE(link->wait_delivered(5s));
}

TEST_F(IngestTest, KeyframesMadeBeforeTheServerStartsAreDelivered) {
  auto link = connect();
  for (std::uint32_t i = 0; i < 5; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  EXPECT_FALSE(link->wait_delivered(100ms));
  EXPECT_FALSE(link->stats().connected);
  auto ingest = serve();
  EXPECT_EQ(take(*ingest, 5), up_to(5));
  EXPECT_TRUE(link->wait_delivered(5s));
}

TEST_F(IngestTest, RestartOfTheServerNeitherLosesNorRepeats) {
  auto ingest = serve(/*capacity=*/8);
  auto link = connect();
  for (std::uint32_t i = 0; i < 40; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  const auto before = take(*ingest, 10);
  ingest.reset();  // with journaled keyframes in its queue: those are in the journal
  const auto journaled = journal_.sequences({"alice", kEpoch});
  ASSERT_GE(journaled.size(), before.size());
  ASSERT_LT(journaled.size(), 40u);
  ingest = serve(8);
  const auto after = take(*ingest, static_cast<std::uint32_t>(40 - journaled.size()));
  EXPECT_EQ(after.front(), journaled.size());
  EXPECT_TRUE(link->wait_delivered(5s));
  EXPECT_EQ(journal_.sequences({"alice", kEpoch}), up_to(40));
}

TEST_F(IngestTest, LinkCutLongerThanTheLeaseNeitherLosesNorRepeats) {
  auto ingest = serve();
  auto link = connect();
  const auto participant = dds::Participant::create({client_domain_, ""});
  ASSERT_TRUE(participant);
  std::uint32_t sequence = 0;
  for (const bool cut : {false, true, false}) {
    ASSERT_TRUE((*participant)->set_cut(cut));
    for (int i = 0; i < 10; ++i) link->send(sample_keyframe_ptr({kEpoch, sequence++}, 500));
    if (cut) {
      EXPECT_FALSE(link->wait_delivered(1500ms));
    }
  }
  EXPECT_EQ(take(*ingest, 30), up_to(30));
  EXPECT_TRUE(link->wait_delivered(8s));
  EXPECT_EQ(journal_.sequences({"alice", kEpoch}), up_to(30));
}

TEST_F(IngestTest, AClientThatWasForgottenInItsSilenceJoinsAgain) {
  forget_after_ = 3s;  // heartbeats come every second
  auto ingest = serve();
  auto link = connect();
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  MapUpdate refresh = sample_update(kEpoch);
  refresh.base_revision = 0;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(ingest->publish({"alice", kEpoch}, refresh));
    ASSERT_TRUE(link->wait_update(5s));
  }
  const auto participant = dds::Participant::create({client_domain_, ""});
  ASSERT_TRUE(participant);
  ASSERT_TRUE((*participant)->set_cut(true));
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kLeft));
  EXPECT_TRUE(ingest->clients().empty());
  forget_events();
  ASSERT_TRUE((*participant)->set_cut(false));
  EXPECT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  link->send(sample_keyframe_ptr({kEpoch, 0}));
  EXPECT_TRUE(link->wait_delivered(5s));
  ASSERT_TRUE(ingest->publish({"alice", kEpoch}, refresh));
  EXPECT_TRUE(link->wait_update(5s)) << "taken for a repeated one";
}

TEST_F(IngestTest, SendingAndPollingTakeMicroseconds) {
  auto ingest = serve();
  auto link = connect();
  std::vector<std::chrono::nanoseconds> times;
  for (std::uint32_t i = 0; i < 200; ++i) {
    const auto keyframe = sample_keyframe_ptr({kEpoch, i}, 0);
    const auto start = std::chrono::steady_clock::now();
    link->send(keyframe);
    (void)link->poll_update();
    times.push_back(std::chrono::steady_clock::now() - start);
  }
  // The median: the machine may stall.
  std::nth_element(times.begin(), times.begin() + 100, times.end());
  EXPECT_LT(times[100], 500us);
}

TEST_F(IngestTest, ServerThatHasLostItsJournalGoesOnFromWhatTheClientHolds) {
  auto ingest = serve();
  auto link = connect();
  for (std::uint32_t i = 0; i < 5; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  ASSERT_TRUE(link->wait_delivered(5s));
  ingest.reset();
  MemoryJournal empty;
  const auto node = net_.node();
  auto fresh = Ingest::start({.domain = node.domain,
                              .partition = "cairn",
                              .queue_capacity = 8,
                              .map = {1},
                              .forget_after = 600s,
                              .on_event = {},
                              .dds_config = node.config},
                             empty);
  ASSERT_TRUE(fresh);
  for (std::uint32_t i = 5; i < 8; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  EXPECT_EQ(take(**fresh, 3), (std::vector<std::uint32_t>{5, 6, 7}));
  EXPECT_TRUE(link->wait_delivered(5s));
}

TEST_F(IngestTest, BrokenJournalDelaysButLosesNothing) {
  auto ingest = serve();
  auto link = connect();
  journal_.broken = true;
  for (std::uint32_t i = 0; i < 5; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  const auto deadline = std::chrono::steady_clock::now() + 10s;
  while (ingest->stats().journal_failures == 0 && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(10ms);
  EXPECT_GT(ingest->stats().journal_failures, 0u);
  EXPECT_FALSE(link->wait_delivered(100ms));
  EXPECT_EQ(link->stats().keyframes_in_outbox, 5u);
  journal_.broken = false;
  EXPECT_EQ(take(*ingest, 5), up_to(5));
  EXPECT_TRUE(link->wait_delivered(5s));
}

TEST_F(IngestTest, RestartedClientDeliversWhatItsFormerRunLeft) {
  {
    auto link = connect();
    for (std::uint32_t i = 0; i < 3; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  }
  ASSERT_TRUE(std::filesystem::exists(outbox("alice")));
  auto ingest = serve();
  auto link = connect("alice", kEpoch + 1);
  link->send(sample_keyframe_ptr({kEpoch + 1, 0}));
  EXPECT_EQ(take(*ingest, 4).size(), 4u);
  EXPECT_TRUE(link->wait_delivered(5s));
  EXPECT_EQ(journal_.sequences({"alice", kEpoch}), up_to(3));
  EXPECT_EQ(journal_.sequences({"alice", kEpoch + 1}), up_to(1));
}

TEST_F(IngestTest, SecondClientOfTheSameNameDeliversNothing) {
  auto ingest = serve();
  auto first = connect();
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined));
  auto second = connect("alice", 99, "other");
  second->send(sample_keyframe_ptr({99, 0}));
  const auto deadline = std::chrono::steady_clock::now() + 10s;
  while (ingest->stats().refused == 0 && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(10ms);
  EXPECT_GT(ingest->stats().refused, 0u);
  EXPECT_FALSE(second->wait_delivered(200ms));
  EXPECT_FALSE(second->stats().connected);
  first->send(sample_keyframe_ptr({kEpoch, 0}));
  EXPECT_TRUE(first->wait_delivered(5s));
}

TEST_F(IngestTest, ClientsAreListed) {
  auto ingest = serve();
  auto alice = connect("alice", 5);
  auto bob = connect("bob", 6);
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined, "alice"));
  ASSERT_TRUE(wait_event(ClientEvent::Kind::kJoined, "bob"));
  const auto clients = ingest->clients();
  ASSERT_EQ(clients.size(), 2u);
  EXPECT_EQ(clients[0].client.name, "alice");
  EXPECT_TRUE(clients[1].connected);
}

TEST_F(IngestTest, AfterCloseWhatWasTakenInIsStillHandedOut) {
  auto ingest = serve();
  auto link = connect();
  for (std::uint32_t i = 0; i < 5; ++i) link->send(sample_keyframe_ptr({kEpoch, i}));
  ASSERT_TRUE(link->wait_delivered(5s));
  ingest->close();
  EXPECT_EQ(take(*ingest, 5), up_to(5));
  EXPECT_FALSE(ingest->next());
}

}  // namespace
}  // namespace cairn
