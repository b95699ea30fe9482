#include "common/util/bounded_queue.h"

#include <atomic>
#include <memory>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using namespace std::chrono_literals;
using ::testing::Optional;

template <typename T>
bool try_push(BoundedQueue<T>& queue, T item) {
  return queue.try_push(item);
}

TEST(BoundedQueue, KeepsTheOrder) {
  BoundedQueue<int> queue(3);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(queue.push(i));
  for (int i = 0; i < 3; ++i) EXPECT_THAT(queue.pop(), Optional(i));
  EXPECT_EQ(queue.try_pop(), std::nullopt);
}

TEST(BoundedQueue, FullQueueRefusesAndLeavesTheItemAlone) {
  BoundedQueue<std::unique_ptr<int>> queue(1);
  auto first = std::make_unique<int>(1), second = std::make_unique<int>(2);
  EXPECT_TRUE(queue.try_push(first));
  EXPECT_FALSE(queue.try_push(second));
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(*second, 2);
  EXPECT_EQ(queue.size(), 1u);
}

TEST(BoundedQueue, PushWaitsForRoom) {
  BoundedQueue<int> queue(1);
  ASSERT_TRUE(queue.push(1));
  std::jthread pusher([&] { EXPECT_TRUE(queue.push(2)); });
  EXPECT_THAT(queue.pop(), Optional(1));
  EXPECT_THAT(queue.pop(), Optional(2));
}

TEST(BoundedQueue, PopWaitsForAnItem) {
  BoundedQueue<int> queue(1);
  std::jthread popper([&] { EXPECT_THAT(queue.pop(), Optional(7)); });
  EXPECT_TRUE(queue.push(7));
}

TEST(BoundedQueue, ClosedQueueTakesNothingButGivesWhatItHas) {
  BoundedQueue<int> queue(4);
  ASSERT_TRUE(queue.push(1));
  queue.close();
  EXPECT_FALSE(queue.push(2));
  EXPECT_FALSE(try_push(queue, 3));
  EXPECT_THAT(queue.pop(), Optional(1));
  EXPECT_EQ(queue.pop(), std::nullopt);
}

TEST(BoundedQueue, ClosingWakesEveryoneWhoWaits) {
  BoundedQueue<int> empty(1), full(1);
  ASSERT_TRUE(full.push(1));
  std::jthread popper([&] { EXPECT_EQ(empty.pop(), std::nullopt); });
  std::jthread pusher([&] { EXPECT_FALSE(full.push(2)); });
  empty.close();
  full.close();
}

TEST(BoundedQueue, StopWakesWhoeverWaits) {
  BoundedQueue<int> empty(1), full(1);
  ASSERT_TRUE(full.push(1));
  std::jthread popper([&](std::stop_token stop) { EXPECT_EQ(empty.pop(stop), std::nullopt); });
  std::jthread pusher([&](std::stop_token stop) { EXPECT_FALSE(full.push(2, stop)); });
  popper.request_stop();
  pusher.request_stop();
}

TEST(BoundedQueue, PopForGivesUpInTime) {
  BoundedQueue<int> queue(1);
  EXPECT_EQ(queue.pop_for(1ms), std::nullopt);
  ASSERT_TRUE(queue.push(5));
  EXPECT_THAT(queue.pop_for(10s), Optional(5));
}

TEST(BoundedQueue, ManyThreadsLoseAndRepeatNothing) {
  constexpr int kThreads = 3, kItems = 500;
  BoundedQueue<int> queue(4);
  std::vector<std::atomic<int>> seen(kThreads * kItems);
  std::vector<std::jthread> poppers, pushers;
  for (int t = 0; t < kThreads; ++t) {
    poppers.emplace_back([&] {
      while (const auto item = queue.pop()) ++seen[*item];
    });
    pushers.emplace_back([&, t] {
      for (int i = 0; i < kItems; ++i) EXPECT_TRUE(queue.push(t * kItems + i));
    });
  }
  pushers.clear();  // joins
  queue.close();
  poppers.clear();
  for (const auto& count : seen) EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace cairn
