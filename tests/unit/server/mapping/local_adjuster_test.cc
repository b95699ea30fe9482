#include "server/mapping/local_adjuster.h"

#include <gmock/gmock.h>

#include <future>
#include <thread>

#include "server/map/invariants.h"
#include "server/mapping/local_mapping.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;

KeyframeId kf(std::uint32_t sequence) {
  return {7, sequence};
}

MapDelta nothing(const Map& map, const LocalWindow&, std::stop_token) {
  return MapDelta::based_on(map);
}

// A walk along a wall, all of it in the map and extended; nothing adjusted yet.
class LocalAdjusterTest : public ::testing::Test {
 protected:
  explicit LocalAdjusterTest(const SyntheticOptions& options = {.keyframes = 13,
                                                                .points = 300,
                                                                .step = 0.3})
      : world_(options), writer_(Map{}) {
    LocalMapping mapping(writer_);
    for (const KeyframePtr& keyframe : world_.keyframes) {
      writer_.submit(keyframe);
      mapping.extend(keyframe->id);
    }
  }

  SyntheticMap world_;
  MapWriter writer_;
};

TEST_F(LocalAdjusterTest, NothingWaitsNothingIsDone) {
  LocalAdjuster adjuster(writer_, nothing);
  EXPECT_THAT(adjuster.adjust(0).keyframes, IsEmpty());
}

TEST_F(LocalAdjusterTest, AKeyframeCountsAsMappedOnceItIsSolved) {
  LocalAdjuster adjuster(writer_, nothing);
  adjuster.add(kf(0));
  EXPECT_EQ(writer_.snapshot()->mapped_of(7), 0u);
  EXPECT_THAT(adjuster.adjust(0).keyframes, ElementsAre(kf(0)));
  EXPECT_EQ(writer_.snapshot()->mapped_of(7), 1u);
  EXPECT_THAT(adjuster.adjust(0).keyframes, IsEmpty());
}

TEST_F(LocalAdjusterTest, WhatTheSolverFindsEndsUpInTheMap) {
  const Rigid3 moved({1, 0, 0, 0}, {0, 0, 9});
  LocalAdjuster adjuster(writer_, [&](const Map& map, const LocalWindow& window, std::stop_token) {
    MapDelta delta = MapDelta::based_on(map);
    for (const KeyframeId id : window.free_keyframes)
      delta.poses.push_back({id, *map.pose_of(id), moved});
    return delta;
  });
  adjuster.add(kf(12));
  EXPECT_TRUE(adjuster.adjust(0).solved);
  EXPECT_EQ(writer_.snapshot()->pose_of(kf(12))->origin(), moved.origin());
}

TEST_F(LocalAdjusterTest, NeighboursShareASolve) {
  std::vector<LocalWindow> windows;
  LocalAdjuster adjuster(writer_, [&](const Map& map, const LocalWindow& window, std::stop_token) {
    windows.push_back(window);
    return MapDelta::based_on(map);
  });
  for (const std::uint32_t k : {10u, 11u, 12u}) adjuster.add(kf(k));
  EXPECT_THAT(adjuster.adjust(0).keyframes, ElementsAre(kf(10), kf(11), kf(12)));
  ASSERT_EQ(windows.size(), 1u);
  for (const std::uint32_t k : {10u, 11u, 12u})
    EXPECT_THAT(windows[0].free_keyframes, Contains(kf(k)));
}

TEST_F(LocalAdjusterTest, WaitsForCompanyWhileMoreKeyframesCome) {
  LocalAdjuster adjuster(writer_, nothing, {.max_together = 4});
  for (std::uint32_t k = 1; k <= 3; ++k) {
    adjuster.add(kf(k));
    EXPECT_THAT(adjuster.adjust(1).keyframes, IsEmpty());
  }
  adjuster.add(kf(4));
  EXPECT_EQ(adjuster.adjust(1).keyframes.size(), 4u) << "enough of them";
}

TEST_F(LocalAdjusterTest, WaitsForNobodyOnceNoMoreCome) {
  LocalAdjuster adjuster(writer_, nothing);
  adjuster.add(kf(3));
  EXPECT_THAT(adjuster.adjust(1).keyframes, IsEmpty());
  EXPECT_THAT(adjuster.adjust(0).keyframes, ElementsAre(kf(3)));
}

TEST_F(LocalAdjusterTest, UnderLoadWindowsAreSmaller) {
  std::vector<std::size_t> sizes;
  LocalAdjuster adjuster(writer_,
                         [&](const Map& map, const LocalWindow& window, std::stop_token) {
                           sizes.push_back(window.free_keyframes.size());
                           return MapDelta::based_on(map);
                         },
                         {.window = {.max_free = 8}, .max_together = 1, .thin_from = 4});
  for (const std::size_t more : {4, 8, 100}) {
    adjuster.add(kf(12));
    adjuster.adjust(more);
  }
  EXPECT_THAT(sizes, ElementsAre(8u, 4u, 3u));
}

TEST_F(LocalAdjusterTest, HoweverSmallTheWindowAllThatItIsForAreSolvedFor) {
  std::vector<KeyframeId> free;
  LocalAdjuster adjuster(writer_,
                         [&](const Map& map, const LocalWindow& window, std::stop_token) {
                           free = window.free_keyframes;
                           return MapDelta::based_on(map);
                         },
                         {.window = {.max_free = 8}, .max_together = 6, .thin_from = 4});
  for (std::uint32_t k = 7; k <= 12; ++k) adjuster.add(kf(k));
  const std::vector<KeyframeId> mapped = adjuster.adjust(100).keyframes;
  EXPECT_GT(mapped.size(), 2u);
  for (const KeyframeId id : mapped) EXPECT_THAT(free, Contains(id));
  EXPECT_GT(free.size(), mapped.size()) << "and for some around them";
}

TEST_F(LocalAdjusterTest, AKeyframeThatIsGoneCountsAsMapped) {
  MapDelta culled = MapDelta::based_on(*writer_.snapshot());
  culled.removed_keyframes = {kf(3)};
  writer_.submit(culled);
  LocalAdjuster adjuster(writer_, nothing);
  adjuster.add(kf(3));
  const LocalAdjustment done = adjuster.adjust(0);
  EXPECT_THAT(done.keyframes, ElementsAre(kf(3)));
  EXPECT_FALSE(done.solved);
  EXPECT_EQ(writer_.snapshot()->mapped_of(7), 4u);
}

// A solver that holds the first solve until told to go on.
struct Gate {
  std::promise<void> entered, may_leave;
  std::atomic<int> solves = 0;

  LocalSolver solver() {
    return [this](const Map& map, const LocalWindow&, std::stop_token) {
      if (solves++ == 0) {
        entered.set_value();
        may_leave.get_future().wait();
      }
      return MapDelta::based_on(map);
    };
  }
};

TEST_F(LocalAdjusterTest, ANeighbourOfWhatIsBeingSolvedIsLeftToThatThread) {
  Gate gate;
  LocalAdjuster adjuster(writer_, gate.solver());
  adjuster.add(kf(11));
  std::vector<KeyframeId> solved;
  std::jthread first([&] {
    while (true) {
      const auto done = adjuster.adjust(0).keyframes;
      if (done.empty()) return;
      solved.insert(solved.end(), done.begin(), done.end());
    }
  });
  gate.entered.get_future().wait();
  adjuster.add(kf(12));
  EXPECT_THAT(adjuster.adjust(0).keyframes, IsEmpty());
  gate.may_leave.set_value();
  first.join();
  EXPECT_THAT(solved, ElementsAre(kf(11), kf(12)));
}

TEST_F(LocalAdjusterTest, WhatIsFarFromASolveDoesNotWaitForIt) {
  const SyntheticMap elsewhere({.keyframes = 3, .seed = 2, .epoch = 8});
  LocalMapping mapping(writer_);
  for (const KeyframePtr& keyframe : elsewhere.keyframes) {
    writer_.submit(keyframe);
    mapping.extend(keyframe->id);
  }
  Gate gate;
  LocalAdjuster adjuster(writer_, gate.solver());
  adjuster.add(kf(2));
  std::jthread first([&] { adjuster.adjust(0); });
  gate.entered.get_future().wait();
  adjuster.add({8, 2});
  EXPECT_THAT(adjuster.adjust(0).keyframes, ElementsAre(KeyframeId{8, 2}));
  gate.may_leave.set_value();
}

// Or it would count as mapped, and those before it in the run with it, which are not yet.
TEST_F(LocalAdjusterTest, ARunsKeyframesAreSolvedForInOrder) {
  Gate gate;
  LocalAdjuster adjuster(writer_, gate.solver(), {.window = {.max_free = 2}});
  adjuster.add(kf(2));
  std::jthread first([&] { adjuster.adjust(0); });
  gate.entered.get_future().wait();
  adjuster.add(kf(12));  // far from it
  EXPECT_THAT(adjuster.adjust(0).keyframes, IsEmpty());
  gate.may_leave.set_value();
  first.join();
  EXPECT_THAT(adjuster.adjust(0).keyframes, ElementsAre(kf(12)));
}

class StillCamera : public LocalAdjusterTest {
 protected:
  StillCamera() : LocalAdjusterTest({.keyframes = 25, .points = 300, .step = 0.005}) {}
};

TEST_F(StillCamera, KeepsANewKeyframeButNotEveryOne) {
  LocalAdjuster adjuster(writer_, nothing);
  int culled = 0;
  for (std::uint32_t k = 0; k < 25; ++k) {
    adjuster.add(kf(k));
    culled += adjuster.adjust(0).keyframes_culled;
  }
  const Snapshot map = writer_.snapshot();
  EXPECT_LT(map->keyframes.size(), 16u);
  EXPECT_TRUE(map->keyframes.contains(kf(24)));
  EXPECT_EQ(map->keyframes.size() + map->removed_keyframes.size(), 25u);
  EXPECT_EQ(static_cast<std::size_t>(culled), map->removed_keyframes.size());
  EXPECT_THAT(check_invariants(*map), IsEmpty());
}

}  // namespace
}  // namespace cairn
