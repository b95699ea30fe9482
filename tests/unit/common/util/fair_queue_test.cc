#include "common/util/fair_queue.h"

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(FairQueue, ServesPartiesInTurn) {
  FairQueue<std::string, int> queue;
  for (int i = 0; i < 3; ++i) queue.push("a", i);
  queue.push("b", 10);
  queue.push("c", 20);
  std::vector<int> order;
  for (int i = 0; i < 5; ++i) {
    const auto taken = queue.take();
    order.push_back(taken->item);
    queue.done(taken->party);
  }
  EXPECT_EQ(order, (std::vector<int>{0, 10, 20, 1, 2}));
}

TEST(FairQueue, GivesOutOnePartysItemsOneAtATime) {
  FairQueue<std::string, int> queue;
  queue.push("a", 1);
  queue.push("a", 2);
  const auto first = queue.take();
  EXPECT_EQ(first->behind, 1u);
  std::stop_source stop;
  std::atomic<bool> got_second = false;
  std::jthread other([&] {
    const auto second = queue.take();
    got_second = second && second->item == 2;
  });
  std::this_thread::yield();
  EXPECT_FALSE(got_second);
  queue.done("a");
  other.join();
  EXPECT_TRUE(got_second);
}

TEST(FairQueue, UrgentItemsComeFirstInTheirOrderAndOneAtATimeToo) {
  FairQueue<std::string, int> queue;
  queue.push("a", 1);
  queue.push("b", 2);
  queue.push_urgent("b", 3);
  queue.push_urgent("b", 4);
  queue.push_urgent("c", 5);
  EXPECT_EQ(queue.size(), 5u);
  const auto first = queue.take();
  EXPECT_EQ(first->item, 3);
  EXPECT_EQ(first->behind, 2u);
  EXPECT_EQ(queue.take()->item, 5);  // b is busy
  EXPECT_EQ(queue.take()->item, 1);
  queue.done("b");
  EXPECT_EQ(queue.take()->item, 4);
  queue.done("b");
  EXPECT_EQ(queue.take()->item, 2);
  EXPECT_EQ(queue.size(), 0u);
}

TEST(FairQueue, UrgentItemsDoNotShiftTheTurnsOfOthers) {
  FairQueue<std::string, int> queue;
  for (int i = 1; i <= 3; ++i) queue.push("a", i);
  queue.push("b", 4);
  const auto next = [&] {
    const auto taken = queue.take();
    queue.done(taken->party);
    return taken->item;
  };
  EXPECT_EQ(next(), 1);
  queue.push_urgent("c", 5);
  EXPECT_TRUE(queue.has_urgent());
  EXPECT_EQ(next(), 5);
  EXPECT_FALSE(queue.has_urgent());
  EXPECT_EQ(next(), 4);  // b's turn still
  EXPECT_EQ(next(), 2);
}

TEST(FairQueue, HandsOutWhatIsLeftAfterClosing) {
  FairQueue<int, int> queue;
  queue.push(1, 7);
  queue.close();
  const auto taken = queue.take();
  ASSERT_TRUE(taken);
  queue.done(1);
  EXPECT_FALSE(queue.take());
}

TEST(FairQueue, AStopEndsTheWait) {
  FairQueue<int, int> queue;
  std::stop_source stop;
  std::jthread waiter([&] { EXPECT_FALSE(queue.take(stop.get_token())); });
  stop.request_stop();
}

TEST(FairQueue, LosesNothingBetweenThreads) {
  FairQueue<int, int> queue;
  std::atomic<int> sum = 0;
  std::vector<int> last(4, -1);
  std::atomic<bool> ordered = true;
  {
    std::vector<std::jthread> takers;
    for (int t = 0; t < 3; ++t)
      takers.emplace_back([&] {
        while (const auto taken = queue.take()) {
          sum += taken->item;
          int& before = last[static_cast<std::size_t>(taken->party)];
          if (taken->item <= before) ordered = false;
          before = taken->item;
          queue.done(taken->party);
        }
      });
    for (int i = 0; i < 200; ++i)
      for (int party = 0; party < 4; ++party) queue.push(party, i);
    queue.close();
  }
  EXPECT_EQ(sum, 4 * 199 * 200 / 2);
  EXPECT_TRUE(ordered);
}

}  // namespace
}  // namespace cairn
