// Landmarks of monocular keyframes: by name, from two views.
#include <gmock/gmock.h>

#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

const SyntheticOptions kMono{.keyframes = 3, .sensor = Sensor::kMono, .step = 0.3};

// Keyframe k with matches that name landmarks after keyframe 0's features, as a client would.
KeyframePtr with_matches(const SyntheticMap& world, std::size_t k) {
  auto keyframe = std::make_shared<Keyframe>(*world.keyframes[k]);
  for (std::size_t f = 0; f < world.point_of[k].size(); ++f)
    for (std::size_t g = 0; g < world.point_of[0].size(); ++g)
      if (world.point_of[k][f] == world.point_of[0][g])
        keyframe->matches.push_back(
            {static_cast<std::uint16_t>(f),
             LandmarkId::from_feature(world.keyframes[0]->id, static_cast<std::uint16_t>(g))});
  return keyframe;
}

TEST(MonoKeyframe, MakesLandmarksWithTheKeyframeThatTheyAreNamedAfter) {
  const SyntheticMap world(kMono);
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  const KeyframeSummary summary = apply_keyframe(map, with_matches(world, 1));
  EXPECT_GT(summary.created, 60);
  EXPECT_LT(summary.rejected, summary.created / 10);
  int near = 0;
  map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
    EXPECT_EQ(id.creator(), world.keyframes[0]->id);
    EXPECT_EQ(landmark.reference, world.keyframes[1]->id) << "on trial with the newer one";
    EXPECT_EQ(landmark.observations.size(), 2u);
    const int point = world.point_of[0][id.creator_feature()];
    near += (landmark.position - world.points[static_cast<std::size_t>(point)]).norm() < 0.3;
  });
  EXPECT_GT(near, 0.8 * summary.created);
  EXPECT_EQ(map.keyframes.at(world.keyframes[1]->id).parent, world.keyframes[0]->id);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(MonoKeyframe, AThirdViewOfTheSameNameIsOneMoreObservation) {
  const SyntheticMap world(kMono);
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  apply_keyframe(map, with_matches(world, 1));
  const KeyframeSummary summary = apply_keyframe(map, with_matches(world, 2));
  EXPECT_GT(summary.accepted, 40);
  int seen_by_all = 0;
  map.landmarks.for_each([&](LandmarkId, const Landmark& landmark) {
    seen_by_all += landmark.observations.size() == 3;
  });
  EXPECT_EQ(seen_by_all, summary.accepted);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(MonoKeyframe, AMatchOfTwoDifferentPointsMakesNothing) {
  const SyntheticMap world(kMono);
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  auto wrong = std::make_shared<Keyframe>(*with_matches(world, 1));
  const auto count = wrong->matches.size();
  ASSERT_GT(count, 20u);
  // Each names its neighbour's landmark.
  const LandmarkId first = wrong->matches.front().landmark;
  for (std::size_t i = 0; i + 1 < count; ++i)
    wrong->matches[i].landmark = wrong->matches[i + 1].landmark;
  wrong->matches.back().landmark = first;
  const KeyframeSummary summary = apply_keyframe(map, wrong);
  EXPECT_LT(summary.created, static_cast<int>(count / 5));
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

// The server has found the point itself by the time that the client's name for it comes.
TEST(MonoKeyframe, ANameWhoseFeatureShowsAnotherLandmarkMeansThatOne) {
  const SyntheticMap world(kMono);
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  apply_keyframe(map, world.keyframes[1]);
  const KeyframePtr third = with_matches(world, 2);
  const LandmarkMatch match = third->matches.front();
  const std::uint16_t in_first = match.landmark.creator_feature();
  const int point = world.point_of[0][in_first];
  MapDelta delta = MapDelta::based_on(map);
  delta.new_landmarks.push_back(
      {world.points[static_cast<std::size_t>(point)], {{world.keyframes[0]->id, in_first}}});
  ASSERT_EQ(apply_delta(map, delta).landmarks_made, 1);
  const LandmarkId servers = map.keyframes.at(world.keyframes[0]->id).landmarks[in_first];
  apply_keyframe(map, third);
  EXPECT_EQ(map.keyframes.at(third->id).landmarks[match.feature], servers);
  EXPECT_FALSE(map.landmarks.contains(match.landmark));
}

}  // namespace
}  // namespace cairn
