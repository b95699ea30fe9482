#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <random>

#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

KeyframeId kf(std::uint32_t sequence) {
  return {7, sequence};
}

const Rigid3 kShift(so3_exp({0, 0.1, 0}), {0.5, 0, 0});  // new_map_from_old_map

TEST(ApplyDelta, FusionMovesObservationsAndTheNameIsFollowed) {
  const SyntheticMap world(
      {.keyframes = 4, .report_share = 0.0, .duplicate_share = 1.0});  // everything is doubled
  Map map = built(world, 4);
  std::map<int, std::vector<LandmarkId>> made_from;  // by point
  for (std::uint32_t k = 1; k < 4; ++k)
    for (const LandmarkMatch& m : world.keyframes[k]->matches)
      made_from[world.point_of[k][m.feature]].push_back(m.landmark);
  const auto three = std::find_if(made_from.begin(), made_from.end(),
                                  [](const auto& made) { return made.second.size() == 3; });
  ASSERT_NE(three, made_from.end());
  const std::vector<LandmarkId>& same = three->second;
  MapDelta delta = MapDelta::based_on(map);
  delta.fusions = {{same[0], same[1]}, {same[1], same[2]}, {same[0], same[2]}};
  const DeltaSummary summary = apply_delta(map, delta);
  EXPECT_EQ(summary.fused, 2);
  EXPECT_EQ(summary.dropped, 1);  // the third says nothing new
  EXPECT_EQ(map.resolve(same[0]), same[2]);
  EXPECT_EQ(map.landmarks.at(same[2]).observations.size(), 3u);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyDelta, SkipsWhatIsGoneAndDropsWhatContradicts) {
  const SyntheticMap world({.keyframes = 4});
  Map map = built(world, 4);
  const Landmark landmark = map.landmarks.at(world.keyframes[0]->matches[0].landmark);
  MapDelta delta = MapDelta::based_on(map);
  delta.new_landmarks.push_back(
      {{0, 0, 3}, {landmark.observations[0], {kf(77), 3}}});  // taken, gone
  delta.new_landmarks.push_back({{0, 0, 3}, {}});
  delta.new_observations.push_back({{0, 4711}, {kf(1), 0}});
  delta.new_observations.push_back({landmark.id, {kf(0), 60000}});
  delta.fusions.push_back({landmark.id, landmark.id});
  delta.removed_observations.push_back({landmark.id, {kf(3), 60000}});
  delta.removed_landmarks.push_back({0, 4711});
  delta.poses.push_back({kf(77), {}, kShift});
  delta.positions.push_back({{0, 4711}, {1, 2, 3}});
  delta.sightings.push_back({{0, 4711}, 1, 1});
  delta.removed_keyframes = {kf(77), kf(0)};  // kf(0) is the root
  const std::size_t landmarks = map.landmarks.size();
  const DeltaSummary summary = apply_delta(map, delta);
  EXPECT_EQ(summary.dropped, 11);
  EXPECT_EQ(map.landmarks.size(), landmarks);
  EXPECT_EQ(map.keyframes.size(), 4u);
  EXPECT_EQ(map.next_landmark, 1u);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyDelta, IsVoidAfterAMerge) {
  const SyntheticMap world({.keyframes = 2});
  Map map = built(world, 2);
  MapDelta delta = MapDelta::based_on(map);
  delta.removed_keyframes = {kf(1)};
  ++map.merge_epoch;
  EXPECT_TRUE(apply_delta(map, delta).is_void);
  EXPECT_EQ(map.keyframes.size(), 2u);
  EXPECT_EQ(map.revision, 2u);
}

TEST(ApplyDelta, WhatArrivedSinceIsCarriedAlong) {
  const SyntheticMap world({.keyframes = 5});
  Map map = built(world, 3);
  MapDelta delta = MapDelta::based_on(map);
  const Rigid3 old = *map.pose_of(kf(2));
  delta.poses.push_back({kf(2), old, kShift * old});
  apply_keyframe(map, world.keyframes[3]);
  apply_keyframe(map, world.keyframes[4]);
  const Map before = map;
  const DeltaSummary summary = apply_delta(map, delta);

  EXPECT_EQ(summary.poses_changed, 1);
  for (const std::uint32_t k : {2u, 3u, 4u}) {
    const Rigid3 error = (kShift * *before.pose_of(kf(k))).inverse() * *map.pose_of(kf(k));
    EXPECT_LT(error.translation.norm() + rotation_angle(error), 1e-9) << k;
    EXPECT_EQ(map.keyframes.at(kf(k)).revision, map.revision);
  }
  EXPECT_EQ(map.keyframes.at(kf(1)).revision, before.keyframes.at(kf(1)).revision);
  int carried = 0;
  map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
    const bool late = landmark.reference.sequence >= 3;
    const Eigen::Vector3d was = before.landmarks.at(id).position;
    EXPECT_LT((landmark.position - (late ? kShift * was : was)).norm(), 1e-9);
    carried += late;
  });
  EXPECT_GT(carried, 10);
  EXPECT_EQ(summary.carried, carried + 2);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyDelta, ItsOwnLandmarksAreNotCarried) {
  const SyntheticMap world({.keyframes = 2, .depth_share = 0.0});
  Map map = built(world, 2);
  MapDelta delta = MapDelta::based_on(map);
  const Rigid3 old = *map.pose_of(kf(1));
  delta.new_landmarks.push_back({{0, 0, 3}, {{kf(1), 0}, {kf(0), 0}}});
  delta.poses.push_back({kf(1), old, kShift * old});
  apply_delta(map, delta);
  EXPECT_EQ(map.landmarks.at({0, 1}).position, Eigen::Vector3d(0, 0, 3));
  EXPECT_EQ(map.landmarks.at({0, 1}).reference, kf(1));
}

TEST(RemoveKeyframe, HandsOnItsChildrenAndRemembersItsPose) {
  const SyntheticMap world({.keyframes = 8});
  Map map = built(world, 8);
  const Map before = map;
  for (const std::uint32_t k : {3u, 4u, 5u}) {
    ASSERT_TRUE(remove_keyframe(map, kf(k)));
    EXPECT_THAT(check_invariants(map), IsEmpty());
  }
  for (const std::uint32_t k : {3u, 4u, 5u}) {
    EXPECT_FALSE(map.keyframes.contains(kf(k)));
    const Rigid3 error = before.pose_of(kf(k))->inverse() * *map.pose_of(kf(k));
    EXPECT_LT(error.translation.norm() + rotation_angle(error), 1e-9);
  }
  EXPECT_FALSE(remove_keyframe(map, kf(0)));                       // a root
  EXPECT_FALSE(remove_keyframe(map, kf(3)));                       // gone
  EXPECT_FALSE(apply_keyframe(map, world.keyframes[3]).inserted);  // does not come back
}

TEST(RemoveKeyframe, LandmarksThatOneOtherSeesVanishAndTheRestGetANewReference) {
  const SyntheticMap world({.keyframes = 4});
  Map map = built(world, 4);
  const Map before = map;
  ASSERT_TRUE(remove_keyframe(map, kf(1)));
  int vanished = 0, handed_on = 0;
  before.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
    if (landmark.reference != kf(1)) return;
    const Landmark* now = map.landmarks.find(id);
    EXPECT_EQ(now == nullptr, landmark.observations.size() <= 2);
    now ? ++handed_on : ++vanished;
    if (now) {
      EXPECT_EQ(now->reference, kf(2));
    }
  });
  EXPECT_GT(vanished, 0);
  EXPECT_GT(handed_on, 0);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

// A keyframe that a removed one is the reference of still finds its place.
TEST(RemoveKeyframe, LateKeyframesHangOnItsAnchor) {
  const SyntheticMap world({.keyframes = 4});
  Map map = built(world, 3);
  ASSERT_TRUE(remove_keyframe(map, kf(2)));
  auto late = std::make_shared<Keyframe>(*world.keyframes[3]);
  late->matches.clear();
  apply_keyframe(map, late);
  EXPECT_TRUE(map.keyframes.contains(map.keyframes.at(kf(3)).parent));
  EXPECT_LT((map.pose_of(kf(3))->origin() - world.map_from_camera[3].origin()).norm(), 1e-9);
}

MapDelta random_delta(const Map& map, std::mt19937_64& random) {
  MapDelta delta = MapDelta::based_on(map);
  const auto keyframes = map.keyframes.sorted_keys();
  const auto landmarks = map.landmarks.sorted_keys();
  if (landmarks.empty()) return delta;
  const auto keyframe = [&] { return keyframes[random() % keyframes.size()]; };
  const auto landmark = [&] { return landmarks[random() % landmarks.size()]; };
  const auto seen = [&] {
    return Observation{keyframe(), static_cast<std::uint16_t>(random() % 300)};
  };
  for (int i = 0; i < 8; ++i) {
    delta.new_landmarks.push_back({{0.1 * i, 0, 3}, {seen(), seen(), seen()}});
    delta.new_observations.push_back({landmark(), seen()});
    delta.fusions.push_back({landmark(), landmark()});
    const Landmark& some = map.landmarks.at(landmark());
    delta.removed_observations.push_back(
        {some.id, some.observations[random() % some.observations.size()]});
    delta.removed_landmarks.push_back(landmark());
    delta.positions.push_back({landmark(), {0, 0.1 * i, 3}});
    delta.sightings.push_back({landmark(), 2, 1});
  }
  const KeyframeId moved = keyframe();
  delta.poses.push_back({moved, *map.pose_of(moved), kShift * *map.pose_of(moved)});
  if (random() % 3 == 0) delta.removed_keyframes = {keyframe(), keyframe()};
  return delta;
}

// Keyframes and deltas that come late and out of step, in random order.
Map random_history(std::uint64_t seed) {
  const SyntheticMap world(
      {.keyframes = 20, .points = 250, .seed = seed, .report_share = 0.8, .duplicate_share = 0.5});
  std::mt19937_64 random(seed);
  Map map;
  std::vector<MapDelta> waiting;
  for (std::size_t k = 0; k < world.keyframes.size();) {
    const auto choice = random() % 3;
    if (choice == 0) {
      apply_keyframe(map, world.keyframes[k++]);
    } else if (choice == 1 && !map.keyframes.empty()) {
      waiting.push_back(random_delta(map, random));
    } else if (!waiting.empty()) {
      const std::size_t i = random() % waiting.size();
      apply_delta(map, waiting[i]);
      waiting.erase(waiting.begin() + static_cast<std::ptrdiff_t>(i));
    }
    if (random() % 5 == 0) {
      EXPECT_THAT(check_invariants(map), IsEmpty()) << "seed " << seed;
    }
  }
  return map;
}

class RandomHistory : public testing::TestWithParam<std::uint64_t> {};

TEST_P(RandomHistory, KeepsTheInvariants) {
  const Map map = random_history(GetParam());
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST_P(RandomHistory, IsTheSameAgain) {
  const Map a = random_history(GetParam()), b = random_history(GetParam());
  EXPECT_EQ(a.revision, b.revision);
  ASSERT_EQ(a.landmarks.sorted_keys(), b.landmarks.sorted_keys());
  a.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
    EXPECT_EQ(landmark.position, b.landmarks.at(id).position);
    EXPECT_EQ(landmark.observations, b.landmarks.at(id).observations);
    EXPECT_EQ(landmark.descriptor, b.landmarks.at(id).descriptor);
  });
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomHistory, testing::Range<std::uint64_t>(1, 7));

}  // namespace
}  // namespace cairn
