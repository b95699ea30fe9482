#include "client/link/inquiry.h"

#include <thread>

#include <gtest/gtest.h>

#include "common/wire/keyframe_codec.h"
#include "common/wire/relocalise_codec.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;

const ClientId kClient{"alice", 42};

KeyframePtr view(std::uint32_t number) {
  auto keyframe =
      std::make_shared<Keyframe>(cairn::testing::sample_keyframe({kClient.epoch, number}, 30));
  keyframe->reference = {};
  keyframe->reference_from_camera = {};
  keyframe->matches.clear();
  return keyframe;
}

class InquiryTest : public ::testing::Test {
 protected:
  void receive(const RelocaliseAnswer& answer, const ClientId& to = kClient) {
    const auto blob = wire::encode_answer(to.name, answer);
    ASSERT_TRUE(blob) << blob.message();
    inquiry_.receive({.client = to, .number = answer.number, .blob = *blob});
  }
  static RelocaliseAnswer answer(std::uint32_t number) {
    RelocaliseAnswer a = cairn::testing::sample_answer(kClient.epoch, 5);
    a.number = number;
    return a;
  }

  int woken_ = 0;
  std::vector<std::uint32_t> sent_;
  bool refuse_ = false;
  Inquiry inquiry_{kClient,
                   [this](const wire::RelocaliseRequestMessage& message) -> Status {
                     if (refuse_) return {ErrorCode::kUnavailable, "no network"};
                     EXPECT_EQ(message.client, kClient);
                     EXPECT_TRUE(wire::decode_keyframe(message.blob));
                     sent_.push_back(message.number);
                     return {};
                   },
                   [this] { ++woken_; }};
};

TEST_F(InquiryTest, SendsTheLatestViewOnce) {
  inquiry_.ask(view(1));
  inquiry_.ask(view(2));
  EXPECT_EQ(woken_, 2);
  EXPECT_TRUE(sent_.empty()) << "sending is for another thread";
  inquiry_.send_waiting();
  inquiry_.send_waiting();
  EXPECT_EQ(sent_, std::vector<std::uint32_t>{2});
  EXPECT_EQ(inquiry_.stats().asked, 1u);
}

TEST_F(InquiryTest, WhatCannotBeSentIsForgotten) {
  refuse_ = true;
  inquiry_.ask(view(1));
  inquiry_.send_waiting();
  refuse_ = false;
  inquiry_.send_waiting();
  EXPECT_TRUE(sent_.empty());
  EXPECT_EQ(inquiry_.stats().asked, 0u);
}

TEST_F(InquiryTest, KeepsTheLatestAnswerUntilItIsTaken) {
  EXPECT_FALSE(inquiry_.poll());
  receive(answer(1));
  receive(answer(2));
  const auto got = inquiry_.poll();
  ASSERT_TRUE(got);
  EXPECT_EQ(got->number, 2u);
  EXPECT_FALSE(inquiry_.poll());
}

TEST_F(InquiryTest, WakesWhoWaitsForAnAnswer) {
  std::jthread server([this] { receive(answer(7)); });
  const auto got = inquiry_.wait(5s);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->number, 7u);
  EXPECT_FALSE(inquiry_.wait(1ms));
}

TEST_F(InquiryTest, AnswersOfOthersAndDamagedOnesAreNotKept) {
  RelocaliseAnswer of_other = cairn::testing::sample_answer(77, 5);
  receive(of_other, {"bob", 77});
  EXPECT_FALSE(inquiry_.poll());
  EXPECT_EQ(inquiry_.stats().malformed, 0u);

  auto blob = *wire::encode_answer(kClient.name, answer(3));
  inquiry_.receive({.client = kClient, .number = 4, .blob = blob});  // head and contents differ
  blob[blob.size() / 2] ^= 1;
  inquiry_.receive({.client = kClient, .number = 3, .blob = blob});
  EXPECT_FALSE(inquiry_.poll());
  EXPECT_EQ(inquiry_.stats().malformed, 2u);
}

}  // namespace
}  // namespace cairn
