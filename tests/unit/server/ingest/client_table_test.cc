#include "server/ingest/client_table.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using namespace std::chrono_literals;
using Kind = ClientEvent::Kind;

class ClientTableTest : public ::testing::Test {
 protected:
  ClientTable::Answer hello(const std::string& name, std::uint64_t epoch,
                            std::chrono::milliseconds at, std::uint32_t refreshes = 0) {
    wire::ClientStateMessage state;
    state.client = {name, epoch};
    state.refresh_requests = refreshes;
    return table_.on_state(state, start_ + at);
  }
  static std::vector<Kind> kinds(const ClientTable::Answer& answer) {
    std::vector<Kind> found;
    for (const auto& event : answer.events) found.push_back(event.kind);
    return found;
  }

  ClientTable table_;
  ClientTable::Clock::time_point start_ = ClientTable::Clock::now();
};

TEST_F(ClientTableTest, JoinsOnceHoweverOftenItSaysHello) {
  EXPECT_EQ(kinds(hello("a", 1, 0s)), (std::vector{Kind::kJoined}));
  EXPECT_TRUE(kinds(hello("a", 1, 1s)).empty());
  EXPECT_TRUE(kinds(hello("a", 1, 60s)).empty());  // after a long silence too
  EXPECT_NE(table_.find({"a", 1}), nullptr);
}

TEST_F(ClientTableTest, SecondRunIsRefusedWhileTheFirstIsHeardOf) {
  hello("a", 1, 0s);
  EXPECT_FALSE(hello("a", 2, 1s).refusal.empty());
  EXPECT_EQ(table_.find({"a", 2}), nullptr);
  EXPECT_TRUE(hello("b", 2, 1s).refusal.empty());
}

TEST_F(ClientTableTest, SecondRunTakesThePlaceOfASilentOne) {
  hello("a", 1, 0s);
  const auto answer = hello("a", 2, ClientTable::kSilence);
  EXPECT_TRUE(answer.refusal.empty());
  EXPECT_EQ(kinds(answer), (std::vector{Kind::kLeft, Kind::kJoined}));
  EXPECT_EQ(answer.ended.at(0).client.epoch, 1u);
  EXPECT_FALSE(hello("a", 1, ClientTable::kSilence + 1ms).refusal.empty());
}

TEST_F(ClientTableTest, RefreshIsToldOncePerRequest) {
  hello("a", 1, 0s, 3);
  EXPECT_EQ(kinds(hello("a", 1, 1s, 4)), (std::vector{Kind::kRefresh}));
  EXPECT_TRUE(kinds(hello("a", 1, 2s, 4)).empty());
}

TEST_F(ClientTableTest, GoodbyeEndsItsOwnSessionOnly) {
  hello("a", 1, 0s);
  wire::ClientStateMessage goodbye;
  goodbye.leaving = true;
  goodbye.client = {"a", 2};
  EXPECT_TRUE(table_.on_state(goodbye, start_).events.empty());
  goodbye.client = {"a", 1};
  EXPECT_EQ(kinds(table_.on_state(goodbye, start_)), (std::vector{Kind::kLeft}));
  EXPECT_TRUE(table_.sessions().empty());
}

TEST_F(ClientTableTest, AnotherProtocolIsRefusedInWords) {
  wire::ClientStateMessage state;
  state.client = {"a", 1};
  state.protocol = 99;
  EXPECT_NE(table_.on_state(state, start_).refusal.find("99"), std::string::npos);
  EXPECT_TRUE(table_.sessions().empty());
}

TEST_F(ClientTableTest, OnlyConnectedNamesDeliverTheirFormerRunsToo) {
  EXPECT_EQ(table_.deliverer({"a", 1}), nullptr);
  hello("a", 2, 0s);
  ASSERT_NE(table_.deliverer({"a", 1}), nullptr);
  EXPECT_EQ(table_.find({"a", 2})->runs, (std::set<std::uint64_t>{1, 2}));
  for (std::uint64_t epoch = 10; epoch < 200; ++epoch) (void)table_.deliverer({"a", epoch});
  EXPECT_EQ(table_.find({"a", 2})->runs.size(), ClientTable::kMaxRuns);
}

TEST_F(ClientTableTest, NumberOfClientsIsBounded) {
  for (std::size_t i = 0; i < ClientTable::kMaxClients; ++i)
    EXPECT_TRUE(hello("client" + std::to_string(i), 1, 0s).refusal.empty());
  EXPECT_FALSE(hello("one-more", 1, 0s).refusal.empty());
}

TEST_F(ClientTableTest, ForgetsWhoWasSilentForLongAndTakesItBack) {
  hello("a", 1, 0s);
  hello("b", 2, 50s);
  EXPECT_TRUE(kinds(table_.expire(start_ + 59s, 60s)).empty());
  const auto answer = table_.expire(start_ + 60s, 60s);
  EXPECT_EQ(kinds(answer), (std::vector{Kind::kLeft}));
  ASSERT_EQ(answer.ended.size(), 1u);
  EXPECT_EQ(answer.ended[0].client, (ClientId{"a", 1}));
  EXPECT_EQ(table_.find({"a", 1}), nullptr);
  EXPECT_NE(table_.find({"b", 2}), nullptr);
  EXPECT_EQ(kinds(hello("a", 1, 61s)), (std::vector{Kind::kJoined}));
}

TEST_F(ClientTableTest, SilentClientsDoNotTakePlacesForEver) {
  for (std::size_t i = 0; i < ClientTable::kMaxClients; ++i) hello(std::to_string(i), i + 1, 0s);
  EXPECT_FALSE(hello("late", 9999, 30s).refusal.empty());
  table_.expire(start_ + 60s, 60s);
  EXPECT_TRUE(hello("late", 9999, 60s).refusal.empty());
}

}  // namespace
}  // namespace cairn
