#include "common/dds/endpoint.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>
#include <optional>

#include "common/dds/wait_loop.h"
#include "common/wire/topics.h"
#include "tests/support/loopback.h"

namespace cairn::dds {
namespace {

using namespace std::chrono_literals;
using cairn::testing::Loopback;

// What a Result holds; ends the test program when it holds an error.
template <typename T>
T must(Result<T> result) {
  if (!result) ADD_FAILURE() << result.message();
  return std::move(*result);
}

// A participant with a loop that collects client states.
struct Listener {
  Listener(const Loopback& net, const std::string& partition) {
    participant = must(Participant::create(net.node()));
    reader.emplace(must(wire::Reader<wire::ClientStateMessage>::create(participant, partition)));
    loop = must(WaitLoop::start(participant, {{reader->condition(), [this] { receive(); }}}, 20ms,
                                [this] { tick(); }));
  }
  ~Listener() { loop->stop(); }
  void receive() {
    EXPECT_TRUE(reader->take([this](const wire::ClientStateMessage& m) {
      std::lock_guard lock(mutex);
      received.push_back(m);
    }));
    changed.notify_all();
  }
  void tick() {
    std::lock_guard lock(mutex);
    ++ticks;
    changed.notify_all();
  }
  template <typename Predicate>
  bool wait(Predicate&& predicate, std::chrono::milliseconds timeout = 5000ms) {
    std::unique_lock lock(mutex);
    return changed.wait_for(lock, timeout, predicate);
  }

  std::shared_ptr<Participant> participant;
  std::optional<wire::Reader<wire::ClientStateMessage>> reader;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<wire::ClientStateMessage> received;
  int ticks = 0;
  std::unique_ptr<WaitLoop> loop;
};

wire::ClientStateMessage state(const std::string& name, std::uint32_t refreshes = 0) {
  return {.client = {name, 42},
          .protocol = wire::kProtocol,
          .sensor = Sensor::kStereo,
          .refresh_requests = refreshes,
          .leaving = true};
}

TEST(Endpoint, MessageArrivesWithAllFields) {
  const Loopback net;
  Listener listener(net, "here");
  auto participant = must(Participant::create(net.node()));
  auto writer = must(wire::Writer<wire::ClientStateMessage>::create(participant, "here"));
  ASSERT_TRUE(writer.write(state(std::string(64, 'n'), 3)));
  ASSERT_TRUE(listener.wait([&] { return !listener.received.empty(); }));
  const auto& got = listener.received[0];
  EXPECT_EQ(got.client, (ClientId{std::string(64, 'n'), 42}));
  EXPECT_EQ(got.sensor, Sensor::kStereo);
  EXPECT_EQ(got.refresh_requests, 3u);
  EXPECT_TRUE(got.leaving);
  EXPECT_TRUE(writer.flush(5s));
  EXPECT_EQ(writer.matched_readers(), 1);
  EXPECT_EQ(listener.reader->matched_writers(), 1);
}

TEST(Endpoint, WhoComesLateGetsTheLatestState) {
  const Loopback net;
  auto participant = must(Participant::create(net.node()));
  auto writer = must(wire::Writer<wire::ClientStateMessage>::create(participant, "here"));
  ASSERT_TRUE(writer.write(state("a", 1)));
  ASSERT_TRUE(writer.write(state("a", 2)));
  Listener listener(net, "here");
  ASSERT_TRUE(listener.wait([&] { return !listener.received.empty(); }));
  EXPECT_EQ(listener.received.back().refresh_requests, 2u);
}

TEST(Endpoint, PartitionsAndTagsKeepMessagesApart) {
  const Loopback net, other_net;
  Listener here(net, "here"), there(net, "there"), elsewhere(other_net, "here");
  auto participant = must(Participant::create(net.node()));
  auto writer = must(wire::Writer<wire::ClientStateMessage>::create(participant, "here"));
  ASSERT_TRUE(writer.write(state("a")));
  ASSERT_TRUE(here.wait([&] { return !here.received.empty(); }));
  EXPECT_FALSE(there.wait([&] { return !there.received.empty(); }, 100ms));
  EXPECT_FALSE(elsewhere.wait([&] { return !elsewhere.received.empty(); }, 100ms));
}

TEST(Endpoint, ImpossibleMessagesAreLeftOutAndCounted) {
  const Loopback net;
  Listener listener(net, "here");
  auto participant = must(Participant::create(net.node()));
  auto writer = must(wire::Writer<wire::ClientStateMessage>::create(participant, "here"));
  ASSERT_TRUE(writer.write(state("no/such*name")));
  ASSERT_TRUE(writer.write(state("good")));
  ASSERT_TRUE(listener.wait([&] { return !listener.received.empty(); }));
  listener.loop->stop();
  EXPECT_EQ(listener.received.size(), 1u);
  EXPECT_EQ(listener.reader->malformed(), 1u);
}

TEST(Endpoint, LargeBlobsArriveUnchanged) {
  const Loopback net;
  auto sender = must(Participant::create(net.node()));
  auto receiver = must(Participant::create(net.node()));
  auto reader = must(wire::Reader<wire::KeyframeMessage>::create(receiver, "here"));
  wire::Blob sent(400'000), got;
  for (std::size_t i = 0; i < sent.size(); ++i) sent[i] = static_cast<std::uint8_t>(i * 31 >> 3);
  std::mutex mutex;
  std::condition_variable changed;
  auto loop = must(WaitLoop::start(receiver,
                                   {{reader.condition(),
                                     [&] {
                                       EXPECT_TRUE(reader.take([&](const wire::KeyframeMessage& m) {
                                         std::lock_guard lock(mutex);
                                         got.assign(m.blob.begin(), m.blob.end());
                                         changed.notify_all();
                                       }));
                                     }}},
                                   1h, [] {}));
  auto writer = must(wire::Writer<wire::KeyframeMessage>::create(sender, "here"));
  std::unique_lock lock(mutex);
  // Volatile: what is written before the two have met is lost, so write until it is not.
  for (int i = 0; i < 50 && got.empty(); ++i) {
    ASSERT_TRUE(writer.write({.client = {"a", 1}, .sequence = 0, .oldest = 0, .blob = sent}));
    changed.wait_for(lock, 100ms, [&] { return !got.empty(); });
  }
  lock.unlock();
  loop->stop();
  EXPECT_EQ(got, sent);
}

TEST(WaitLoop, TicksWakesAndStops) {
  const Loopback net;
  Listener listener(net, "here");
  EXPECT_TRUE(listener.wait([&] { return listener.ticks >= 3; }));
  auto participant = must(Participant::create(net.node()));
  int woken = 0;
  std::mutex mutex;
  std::condition_variable changed;
  auto loop = must(WaitLoop::start(participant, {}, 1h, [&] {
    std::lock_guard lock(mutex);
    ++woken;
    changed.notify_all();
  }));
  loop->wake();
  std::unique_lock lock(mutex);
  EXPECT_TRUE(changed.wait_for(lock, 5s, [&] { return woken == 1; }));
  lock.unlock();
  loop->stop();
  loop->stop();
  EXPECT_EQ(woken, 1);
}

TEST(Participant, ErrorsAreOneClearLine) {
  const auto out_of_range = Participant::create({300, ""});
  ASSERT_FALSE(out_of_range);
  EXPECT_EQ(out_of_range.message(), "DDS domain 300: use 0 to 232");
  const auto bad_config = Participant::create({231, "<CycloneDDS><Nonsense/></CycloneDDS>"});
  ASSERT_FALSE(bad_config);
  EXPECT_NE(bad_config.message().find("configuration"), std::string::npos);
}

}  // namespace
}  // namespace cairn::dds
