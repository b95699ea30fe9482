#include "server/mapping/fuse.h"

#include <gmock/gmock.h>

#include <map>
#include <set>

#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "server/mapping/sightings.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

std::set<int> points_of(const SyntheticMap& world, const Landmark& landmark) {
  std::set<int> points;
  for (const Observation& o : landmark.observations)
    points.insert(world.point_of[o.keyframe.sequence][o.feature]);
  return points;
}

// Landmarks beyond the first one of each point.
int duplicates(const SyntheticMap& world, const Map& map) {
  std::map<int, int> landmarks;
  map.landmarks.for_each([&](LandmarkId, const Landmark& l) {
    for (const int point : points_of(world, l)) ++landmarks[point];
  });
  int extra = 0;
  for (const auto& [point, count] : landmarks) extra += count - 1;
  return extra;
}

int mixed(const SyntheticMap& world, const Map& map) {
  int count = 0;
  map.landmarks.for_each(
      [&](LandmarkId, const Landmark& l) { count += points_of(world, l).size() > 1; });
  return count;
}

TEST(Fuse, FindsTheObservationsThatNobodyReported) {
  const SyntheticMap world({.keyframes = 5, .report_share = 0.5});
  Map map = built(world);
  GridCache grids;
  const DeltaSummary summary = apply_delta(map, fuse(map, {7, 4}, grids));
  EXPECT_GT(summary.observations_added, 100);
  EXPECT_LE(mixed(world, map), 2);
  EXPECT_THAT(check_invariants(map), IsEmpty());
  // Hardly a feature is left without the landmark that others have of its point.
  std::set<int> known;
  map.landmarks.for_each([&](LandmarkId, const Landmark& l) { known.merge(points_of(world, l)); });
  const KeyframeNode& node = map.keyframes.at({7, 4});
  int free = 0, all = 0;
  for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
    if (!known.contains(world.point_of[4][f])) continue;
    free += !node.landmarks[f].is_valid();
    ++all;
  }
  EXPECT_GT(all, 60);
  EXPECT_LT(free, all / 8);
}

TEST(Fuse, JoinsDuplicates) {
  const SyntheticMap world({.keyframes = 6, .report_share = 0.7, .duplicate_share = 0.8});
  Map map = built(world);
  const int before = duplicates(world, map);
  ASSERT_GT(before, 50);
  GridCache grids;
  for (std::uint32_t k = 0; k < 6; ++k) apply_delta(map, fuse(map, {7, k}, grids));
  EXPECT_LT(duplicates(world, map), before / 5);
  EXPECT_LE(mixed(world, map), 3);
  EXPECT_GT(map.replaced_landmarks.size(), 40u);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(Fuse, KeepsTheLandmarkThatIsSeenMore) {
  const SyntheticMap world({.keyframes = 6, .report_share = 0.7, .duplicate_share = 0.8});
  const Map map = built(world);
  GridCache grids;
  const MapDelta delta = fuse(map, {7, 5}, grids);
  ASSERT_FALSE(delta.fusions.empty());
  for (const auto& [from, into] : delta.fusions) {
    const Landmark &gone = map.landmarks.at(from), &kept = map.landmarks.at(into);
    EXPECT_GE(kept.observations.size(), gone.observations.size());
    if (kept.observations.size() == gone.observations.size()) {
      EXPECT_LT(into, from);
    }
  }
}

TEST(Fuse, LeavesPointsThatLookDifferentApart) {
  SyntheticMap world({.keyframes = 2, .report_share = 0.0, .duplicate_share = 1.0});
  auto other = std::make_shared<Keyframe>(*world.keyframes[1]);
  for (Descriptor& d : other->features.descriptors)
    for (std::uint64_t& word : d) word = ~word;
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  apply_keyframe(map, other);
  GridCache grids;
  EXPECT_TRUE(fuse(map, {7, 1}, grids).empty());
}

TEST(Fuse, TheSameAgainGivesTheSame) {
  const SyntheticMap world({.keyframes = 6, .report_share = 0.5, .duplicate_share = 0.5});
  const Map map = built(world);
  GridCache a, b(1);
  const MapDelta first = fuse(map, {7, 5}, a), second = fuse(map, {7, 5}, b);
  ASSERT_EQ(first.fusions.size(), second.fusions.size());
  ASSERT_EQ(first.new_observations.size(), second.new_observations.size());
  for (std::size_t i = 0; i < first.fusions.size(); ++i)
    EXPECT_EQ(first.fusions[i].from, second.fusions[i].from);
  for (std::size_t i = 0; i < first.new_observations.size(); ++i)
    EXPECT_EQ(first.new_observations[i].observation, second.new_observations[i].observation);
}

TEST(Sightings, CountWhatShouldBeSeenAndWhatIs) {
  const SyntheticMap world({.keyframes = 4, .report_share = 0.5});
  Map map = built(world);
  GridCache grids;
  MapDelta delta = MapDelta::based_on(map);
  delta.sightings = sightings(map, {7, 3}, grids);
  int found = 0, missed = 0;
  for (const auto& [id, visible, seen] : delta.sightings) {
    EXPECT_EQ(visible, 1u);
    const auto& shown = map.keyframes.at({7, 3}).landmarks;
    EXPECT_EQ(seen == 1, std::find(shown.begin(), shown.end(), id) != shown.end());
    ++(seen ? found : missed);
  }
  EXPECT_GT(found, 20);
  EXPECT_GT(missed, 20);  // reports are left out at random
  const LandmarkId id = delta.sightings.front().landmark;
  const std::uint32_t visible = map.landmarks.at(id).visible;
  apply_delta(map, delta);
  EXPECT_EQ(map.landmarks.at(id).visible, visible + 1);
}

TEST(Sightings, CountOnlyWhatIsOnTrial) {
  const SyntheticMap world({.keyframes = 6, .report_share = 0.5});
  Map map = built(world);
  GridCache grids;
  const auto all = sightings(map, {7, 5}, grids);
  map.mapped_keyframes.insert(7, 5);
  const auto some = sightings(map, {7, 5}, grids);
  EXPECT_GE(some.size(), 10u);
  EXPECT_LT(some.size() + 20, all.size());
  for (const auto& sighting : some)
    EXPECT_GE(map.landmarks.at(sighting.landmark).reference.sequence, 2u);
}

// Those that don't count would change no verdict.
TEST(Sightings, OfWhatIsOnTrialAreEnoughToJudge) {
  const SyntheticMap world({.keyframes = 8, .report_share = 0.5});
  Map all = built(world), some = all;
  GridCache grids;
  CullOptions judging, counting_all;
  judging.min_found_share = 0.6;
  counting_all.trial = 1000;
  std::size_t counted_all = 0, counted = 0, failed = 0;
  const auto count = [&](Map& map, KeyframeId id, const CullOptions& options) {
    MapDelta delta = MapDelta::based_on(map);
    delta.sightings = sightings(map, id, grids, 10, {}, options);
    delta.mapped_keyframes = {id};
    apply_delta(map, delta);
    return delta.sightings.size();
  };
  for (std::uint32_t k = 0; k < 8; ++k) {
    const auto verdict = landmarks_failing_trial(some, {7, k}, judging);
    EXPECT_EQ(verdict, landmarks_failing_trial(all, {7, k}, judging)) << "keyframe " << k;
    failed += verdict.size();
    counted_all += count(all, {7, k}, counting_all);
    counted += count(some, {7, k}, judging);
  }
  EXPECT_GT(failed, 0u);
  EXPECT_LT(counted, counted_all);
}

TEST(Sightings, WhatIsAboutToBeFusedWithOneSeenIsFound) {
  const SyntheticMap world({.keyframes = 4, .report_share = 0.5, .duplicate_share = 0.5});
  const Map map = built(world);
  GridCache grids;
  const auto fusions = fuse(map, {7, 3}, grids, {}, FuseDirection::kFrom).fusions;
  ASSERT_FALSE(fusions.empty());
  const auto count_found = [](const std::vector<MapDelta::Sighting>& all) {
    return std::count_if(all.begin(), all.end(), [](const auto& s) { return s.found > 0; });
  };
  EXPECT_GT(count_found(sightings(map, {7, 3}, grids, 10, fusions)),
            count_found(sightings(map, {7, 3}, grids)));
}

}  // namespace
}  // namespace cairn
