#include "server/map/map_writer.h"

#include <gmock/gmock.h>

#include <atomic>
#include <thread>

#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

TEST(MapWriter, AppliesEventsInOrderAndPublishesEach) {
  const SyntheticMap world({.keyframes = 3, .points = 200});
  MapWriter writer(Map{});
  const Snapshot empty = writer.snapshot();
  std::vector<std::future<Applied>> pending;
  for (const KeyframePtr& keyframe : world.keyframes) pending.push_back(writer.post(keyframe));
  for (std::size_t k = 0; k < 3; ++k) {
    const Applied applied = pending[k].get();
    EXPECT_TRUE(applied.done);
    EXPECT_TRUE(applied.keyframe.inserted);
    EXPECT_EQ(applied.snapshot->revision, k + 1);
    EXPECT_EQ(applied.snapshot->keyframes.size(), k + 1);
  }
  EXPECT_EQ(writer.snapshot()->revision, 3u);
  EXPECT_TRUE(empty->keyframes.empty());
}

TEST(MapWriter, ClosingAppliesWhatWaitsAndRefusesTheRest) {
  const SyntheticMap world({.keyframes = 4, .points = 200});
  MapWriter writer(Map{});
  std::vector<std::future<Applied>> pending;
  for (std::size_t k = 0; k < 3; ++k) pending.push_back(writer.post(world.keyframes[k]));
  writer.close();
  for (auto& applied : pending) EXPECT_TRUE(applied.get().done);
  const Applied late = writer.submit(world.keyframes[3]);
  EXPECT_FALSE(late.done);
  EXPECT_EQ(late.snapshot, nullptr);
  EXPECT_EQ(writer.snapshot()->keyframes.size(), 3u);
}

TEST(MapWriter, SnapshotsStayAsTheyAreWhileTheMapGrows) {
  const SyntheticMap world({.keyframes = 12, .points = 200});
  MapWriter writer(Map{});
  std::atomic<bool> done = false;
  std::jthread reader([&] {
    while (!done) {
      const Snapshot map = writer.snapshot();
      EXPECT_THAT(check_invariants(*map), IsEmpty());
    }
  });
  for (const KeyframePtr& keyframe : world.keyframes) {
    const Applied applied = writer.submit(keyframe);
    MapDelta delta = MapDelta::based_on(*applied.snapshot);
    for (const LandmarkId id : applied.snapshot->landmarks.sorted_keys())
      delta.positions.push_back({id, applied.snapshot->landmarks.at(id).position * 1.001});
    writer.submit(std::move(delta));
  }
  done = true;
}

}  // namespace
}  // namespace cairn
