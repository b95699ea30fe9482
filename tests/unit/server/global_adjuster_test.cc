#include "server/global_adjuster.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <condition_variable>
#include <mutex>
#include <vector>

#include "common/util/clock.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using Ticket = GlobalAdjuster::Ticket;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

constexpr std::chrono::seconds kNever{60};  // longer than any test

struct Adjusting {
  Adjusting(std::chrono::milliseconds pause, std::chrono::milliseconds longest_burst)
      : options{.pause = pause, .longest_burst = longest_burst} {}

  const GlobalAdjusterOptions options;
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<std::vector<Ticket>> done;  // of each adjustment
  MapWriter writer{built(SyntheticMap({.keyframes = 5}))};
  GlobalAdjuster adjuster{writer, options, [this](const std::vector<Ticket>& tickets) {
                            {
                              std::lock_guard lock(mutex);
                              done.push_back(tickets);
                            }
                            changed.notify_all();
                          }};

  // Until the ticket is done, without telling the adjuster that somebody waits.
  void wait_for(Ticket ticket) {
    std::unique_lock lock(mutex);
    changed.wait_for(lock, std::chrono::seconds(30), [&] {
      return !done.empty() && std::count(done.back().begin(), done.back().end(), ticket) > 0;
    });
  }
};

TEST(GlobalAdjuster, ABurstOfLoopsIsAdjustedOnce) {
  Adjusting run(std::chrono::seconds(2), kNever);
  const Stopwatch watch;
  Ticket last = 0;
  for (int i = 0; i < 5; ++i) last = run.adjuster.request({7, 4}, true);
  run.wait_for(last);
  EXPECT_THAT(run.done, ElementsAre(SizeIs(5)));
  EXPECT_GE(watch.milliseconds(), 1900);
}

TEST(GlobalAdjuster, LoopsWithoutEndAreAdjustedAllTheSame) {
  Adjusting run(kNever, std::chrono::seconds(1));
  const Stopwatch watch;
  std::unique_lock lock(run.mutex);
  while (run.done.empty() && watch.milliseconds() < 20'000) {
    lock.unlock();
    run.adjuster.request({7, 4}, true);
    lock.lock();
    run.changed.wait_for(lock, std::chrono::milliseconds(100));
  }
  EXPECT_THAT(run.done, Not(IsEmpty()));
  EXPECT_GE(watch.milliseconds(), 900);
  EXPECT_GE(run.done.front().size(), 2u);
}

TEST(GlobalAdjuster, WhoWaitsIsNotKeptWaitingForMoreLoops) {
  Adjusting run(kNever, kNever);
  run.adjuster.request({7, 4}, true);
  const Stopwatch watch;
  run.adjuster.wait_idle();
  EXPECT_THAT(run.done, ElementsAre(SizeIs(1)));
  EXPECT_LT(watch.milliseconds(), 30'000);
}

TEST(GlobalAdjuster, FindsThePartOfAKeyframeThatHasBeenCulledSince) {
  Adjusting run(kNever, kNever);
  MapDelta cull = MapDelta::based_on(*run.writer.snapshot());
  cull.removed_keyframes = {{7, 4}};
  ASSERT_TRUE(run.writer.submit(std::move(cull)).done);
  ASSERT_FALSE(run.writer.snapshot()->keyframes.contains({7, 4}));
  run.adjuster.request({7, 4}, false);
  run.adjuster.wait_idle();
  EXPECT_EQ(run.adjuster.adjustments(), 1u);
}

TEST(GlobalAdjuster, WhatIsNoLoopBeginsAtOnce) {
  Adjusting run(kNever, kNever);
  run.adjuster.request({7, 4}, true);
  const Stopwatch watch;
  run.wait_for(run.adjuster.request({7, 3}, false));
  EXPECT_THAT(run.done, ElementsAre(SizeIs(2)));  // one part, one adjustment
  EXPECT_LT(watch.milliseconds(), 25'000);
}

}  // namespace
}  // namespace cairn
