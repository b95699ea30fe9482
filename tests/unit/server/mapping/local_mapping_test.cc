#include "server/mapping/local_mapping.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;

KeyframeId kf(std::uint32_t sequence) {
  return {7, sequence};
}

TEST(LocalWindow, HoldsTheCentreItsFriendsAndWitnesses) {
  const SyntheticMap world({.keyframes = 12, .step = 0.3});
  const Map map = built(world);
  const std::vector<KeyframeId> centres{kf(11)};
  const LocalWindow window = choose_local_window(map, centres, {.max_free = 4, .max_fixed = 3});
  EXPECT_EQ(window.free_keyframes.size(), 4u);
  EXPECT_THAT(window.free_keyframes, Contains(kf(11)));
  EXPECT_EQ(window.fixed_keyframes.size(), 3u);
  EXPECT_TRUE(std::is_sorted(window.free_keyframes.begin(), window.free_keyframes.end()));
  EXPECT_TRUE(std::is_sorted(window.landmarks.begin(), window.landmarks.end()));
  for (const KeyframeId id : window.fixed_keyframes)
    EXPECT_THAT(window.free_keyframes, Not(Contains(id)));
  for (const KeyframeId id : window.free_keyframes)
    for (const LandmarkId l : map.keyframes.at(id).landmarks)
      if (l.is_valid()) {
        EXPECT_TRUE(std::binary_search(window.landmarks.begin(), window.landmarks.end(), l));
      }
}

TEST(LocalWindow, SomethingAlwaysHoldsTheFrame) {
  const SyntheticMap world({.keyframes = 4});
  const Map map = built(world);
  const std::vector<KeyframeId> centres{kf(3), kf(77)};
  const LocalWindow all = choose_local_window(map, centres);
  EXPECT_THAT(all.fixed_keyframes, ElementsAre(kf(0)));  // the root
  EXPECT_THAT(all.free_keyframes, ElementsAre(kf(1), kf(2), kf(3)));
  const std::vector<KeyframeId> root{kf(0)};
  EXPECT_THAT(choose_local_window(built(SyntheticMap({.keyframes = 1})), root).free_keyframes,
              IsEmpty());
}

TEST(LocalWindow, CoalescedKeyframesAreAllCentres) {
  const SyntheticMap world({.keyframes = 12, .step = 0.4});
  const Map map = built(world);
  const std::vector<KeyframeId> centres{kf(4), kf(11)};
  const LocalWindow window = choose_local_window(map, centres, {.max_free = 2});
  EXPECT_THAT(window.free_keyframes, ElementsAre(kf(4), kf(11)));
}

// Feeds all keyframes to the mapping, `backlog` of them waiting behind each.
std::vector<LocalMappingReport> run(const SyntheticMap& world, MapWriter& writer,
                                    LocalSolver solver, std::size_t backlog = 0) {
  LocalMapping mapping(writer, std::move(solver));
  std::vector<LocalMappingReport> reports;
  for (const KeyframePtr& keyframe : world.keyframes) {
    writer.submit(keyframe);
    reports.push_back(mapping.map_keyframe(keyframe->id, backlog));
  }
  return reports;
}

MapDelta nothing(const Map& map, const LocalWindow&, std::stop_token) {
  return MapDelta::based_on(map);
}

TEST(LocalMapping, BuildsAValidMapWithFewDuplicates) {
  const SyntheticMap world(
      {.keyframes = 14, .depth_share = 0.6, .report_share = 0.5, .duplicate_share = 0.5});
  MapWriter writer(Map{});
  const auto reports = run(world, writer, nothing);
  const Snapshot map = writer.snapshot();
  EXPECT_THAT(check_invariants(*map), IsEmpty());
  int made = 0, fused = 0, added = 0;
  for (const LocalMappingReport& r : reports) {
    EXPECT_TRUE(r.found);
    made += r.landmarks_made, fused += r.fused, added += r.observations_added;
  }
  EXPECT_GT(made, 30);
  EXPECT_GT(fused, 20);
  EXPECT_GT(added, 200);
  double error = 0;
  map->landmarks.for_each([&](LandmarkId, const Landmark& l) {
    const Observation& o = l.observations.front();
    const auto point = static_cast<std::size_t>(world.point_of[o.keyframe.sequence][o.feature]);
    error += (l.position - world.points[point]).norm() / static_cast<double>(map->landmarks.size());
  });
  EXPECT_LT(error, 0.1);
}

TEST(LocalMapping, TheSameInputMakesTheSameMap) {
  const SyntheticMap world({.keyframes = 10, .report_share = 0.6, .duplicate_share = 0.4});
  MapWriter first(Map{}), second(Map{});
  run(world, first, nothing);
  run(world, second, nothing);
  const Snapshot a = first.snapshot(), b = second.snapshot();
  EXPECT_EQ(a->revision, b->revision);
  EXPECT_EQ(a->keyframes.sorted_keys(), b->keyframes.sorted_keys());
  ASSERT_EQ(a->landmarks.sorted_keys(), b->landmarks.sorted_keys());
  a->landmarks.for_each([&](LandmarkId id, const Landmark& l) {
    EXPECT_EQ(l.position, b->landmarks.at(id).position);
    EXPECT_EQ(l.observations, b->landmarks.at(id).observations);
  });
}

TEST(LocalMapping, SolvesOnceForMany) {
  const SyntheticMap world({.keyframes = 13, .points = 300, .step = 0.3});
  std::vector<LocalWindow> windows;
  MapWriter writer(Map{});
  const auto reports = run(
      world, writer,
      [&](const Map& map, const LocalWindow& window, std::stop_token) {
        windows.push_back(window);
        return MapDelta::based_on(map);
      },
      3);
  ASSERT_EQ(windows.size(), 2u);  // after the 6th and the 12th: max_coalesced
  for (std::uint32_t k = 6; k < 12; ++k) EXPECT_THAT(windows[1].free_keyframes, Contains(kf(k)));
  EXPECT_TRUE(reports[5].solved);
  EXPECT_FALSE(reports[6].solved);
}

TEST(LocalMapping, WhatTheSolverFindsEndsUpInTheMap) {
  const SyntheticMap world({.keyframes = 3, .points = 300});
  MapWriter writer(Map{});
  const Rigid3 moved({1, 0, 0, 0}, {0, 0, 9});
  run(world, writer, [&](const Map& map, const LocalWindow& window, std::stop_token) {
    MapDelta delta = MapDelta::based_on(map);
    for (const KeyframeId id : window.free_keyframes)
      delta.poses.push_back({id, *map.pose_of(id), moved});
    return delta;
  });
  EXPECT_EQ(writer.snapshot()->pose_of(kf(2))->origin(), moved.origin());
}

TEST(LocalMapping, KeepsANewKeyframeOfAStillCameraButNotEveryOne) {
  const SyntheticMap world({.keyframes = 25, .points = 300, .step = 0.005});
  MapWriter writer(Map{});
  run(world, writer, nothing);
  const Snapshot map = writer.snapshot();
  EXPECT_LT(map->keyframes.size(), 16u);
  EXPECT_TRUE(map->keyframes.contains(kf(24)));
  EXPECT_EQ(map->keyframes.size() + map->removed_keyframes.size(), 25u);
  EXPECT_THAT(check_invariants(*map), IsEmpty());
}

TEST(LocalMapping, KeyframesCountAsMappedOnceTheyAreSolved) {
  const SyntheticMap world({.keyframes = 4, .points = 300});
  MapWriter writer(Map{});
  LocalMapping mapping(writer, nothing);
  for (const KeyframePtr& keyframe : world.keyframes) writer.submit(keyframe);
  mapping.map_keyframe(kf(0), 3);
  mapping.map_keyframe(kf(1), 2);
  EXPECT_EQ(writer.snapshot()->mapped_of(7), 0u);
  mapping.map_keyframe(kf(2), 0);
  EXPECT_EQ(writer.snapshot()->mapped_of(7), 3u);
  EXPECT_THAT(writer.snapshot()->unmapped(), ElementsAre(kf(3)));
}

TEST(LocalMapping, AKeyframeThatIsGoneDoesNotKeepTheOthersUnsolved) {
  const SyntheticMap world({.keyframes = 4, .points = 300});
  MapWriter writer(Map{});
  LocalMapping mapping(writer, nothing);
  for (const KeyframePtr& keyframe : world.keyframes) writer.submit(keyframe);
  mapping.map_keyframe(kf(2), 1);
  MapDelta culled = MapDelta::based_on(*writer.snapshot());
  culled.removed_keyframes = {kf(3)};
  writer.submit(culled);
  const LocalMappingReport report = mapping.map_keyframe(kf(3), 0);
  EXPECT_FALSE(report.found);
  EXPECT_TRUE(report.solved);
  EXPECT_EQ(writer.snapshot()->mapped_of(7), 4u);
}

TEST(LocalMapping, AnUnknownKeyframeIsReported) {
  MapWriter writer(Map{});
  LocalMapping mapping(writer, nothing);
  EXPECT_FALSE(mapping.map_keyframe(kf(0), 0).found);
  EXPECT_EQ(writer.snapshot()->mapped_of(7), 0u);
}

}  // namespace
}  // namespace cairn
