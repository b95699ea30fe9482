#include <gmock/gmock.h>

#include <algorithm>

#include "common/feature/hamming.h"
#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "server/map/refresh.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

std::shared_ptr<Keyframe> changed(const KeyframePtr& keyframe) {
  return std::make_shared<Keyframe>(*keyframe);
}

TEST(ApplyKeyframe, TheFirstOneMakesItsLandmarksAtTheOrigin) {
  const SyntheticMap world({.keyframes = 1});
  Map map;
  const KeyframeSummary summary = apply_keyframe(map, world.keyframes[0]);
  const auto& matches = world.keyframes[0]->matches;
  EXPECT_TRUE(summary.inserted);
  EXPECT_EQ(summary.created, std::ssize(matches));
  EXPECT_EQ(map.revision, 1u);
  EXPECT_EQ(map.keyframes_ever, 1u);
  const Landmark& landmark = map.landmarks.at(matches[5].landmark);
  const auto point = static_cast<std::size_t>(world.point_of[0][matches[5].feature]);
  EXPECT_LT((landmark.position - world.points[point]).norm(), 0.25);
  EXPECT_FALSE(map.keyframes.at(world.keyframes[0]->id).parent.is_valid());
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyKeyframe, MatchesBecomeObservationsAndCovisibility) {
  const SyntheticMap world({.keyframes = 6});
  Map map;
  int accepted = 0, rejected = 0;
  for (const KeyframePtr& keyframe : world.keyframes) {
    const KeyframeSummary summary = apply_keyframe(map, keyframe);
    accepted += summary.accepted;
    rejected += summary.rejected;
  }
  EXPECT_GT(accepted, 300);
  EXPECT_LT(rejected, accepted / 50);
  EXPECT_THAT(check_invariants(map), IsEmpty());
  const KeyframeNode& last = map.keyframes.at({7, 5});
  ASSERT_FALSE(last.covisible.empty());
  EXPECT_EQ(last.parent, last.covisible.front().keyframe);
}

TEST(ApplyKeyframe, ThePoseFollowsItsReference) {
  const SyntheticMap world({.keyframes = 4});
  const Map map = built(world);
  for (std::size_t k = 0; k < 4; ++k) {
    const Rigid3 error = world.map_from_camera[k].inverse() *
                         map.keyframes.at(world.keyframes[k]->id).map_from_camera;
    EXPECT_LT(error.translation.norm(), 1e-9);
  }
}

TEST(ApplyKeyframe, AnUnknownReferenceIsReplacedByOdometry) {
  const SyntheticMap world({.keyframes = 4});
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  auto keyframe = changed(world.keyframes[3]);
  keyframe->reference = {99, 1};
  apply_keyframe(map, keyframe);
  const Rigid3 error = world.map_from_camera[3].inverse() * *map.pose_of(keyframe->id);
  EXPECT_LT(error.translation.norm(), 1e-9);
}

TEST(ApplyKeyframe, ARunThatComesToAnEmptyMapInItsMiddleIsPlacedByOdometry) {
  const SyntheticMap world({.keyframes = 4});
  Map map;
  apply_keyframe(map, world.keyframes[2]);
  const Rigid3 error =
      world.keyframes[2]->odom_from_camera.pose().inverse() * *map.pose_of(world.keyframes[2]->id);
  EXPECT_LT(error.translation.norm(), 1e-9);
  EXPECT_LT(rotation_angle(error), 1e-9);
  apply_keyframe(map, world.keyframes[3]);
  const Rigid3 next =
      world.keyframes[3]->odom_from_camera.pose().inverse() * *map.pose_of(world.keyframes[3]->id);
  EXPECT_LT(next.translation.norm(), 1e-9);
}

// Each by what the wire allows, all together by more than numbers can hold.
TEST(ApplyKeyframe, AChainOfScalesStaysWithinBounds) {
  for (const double scale : {1e6, 1e-6}) {
    const SyntheticMap world({.keyframes = 60});
    Map map;
    for (const KeyframePtr& original : world.keyframes) {
      auto keyframe = changed(original);
      keyframe->reference_from_camera.scale *= scale;
      apply_keyframe(map, keyframe);
      const KeyframeNode& node = map.keyframes.at(keyframe->id);
      ASSERT_TRUE(node.map_from_camera.is_finite()) << keyframe->id.sequence;
      ASSERT_GE(node.unit, 1e-6);
      ASSERT_LE(node.unit, 1e6);
    }
    EXPECT_THAT(check_invariants(map), testing::IsEmpty());
  }
}

TEST(ApplyKeyframe, TheSameOneAgainChangesNothing) {
  const SyntheticMap world({.keyframes = 2});
  Map map = built(world);
  EXPECT_FALSE(apply_keyframe(map, world.keyframes[1]).inserted);
  EXPECT_EQ(map.revision, 2u);
}

TEST(ApplyKeyframe, AMatchFarFromItsFeatureIsRejected) {
  const SyntheticMap world({.keyframes = 2});
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  auto keyframe = changed(world.keyframes[1]);
  for (Feature& f : keyframe->features.points) f.x += f.x < 320 ? 60.f : -60.f;
  const KeyframeSummary summary = apply_keyframe(map, keyframe);
  EXPECT_EQ(summary.accepted, 0);
  EXPECT_GT(summary.rejected, 50);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyKeyframe, OneLandmarkIsTakenForOneFeatureOnly) {
  const SyntheticMap world({.keyframes = 2});
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  auto keyframe = changed(world.keyframes[1]);
  const LandmarkMatch twice = keyframe->matches.front();
  keyframe->features.points.push_back(keyframe->features.points[twice.feature]);
  keyframe->features.descriptors.push_back(keyframe->features.descriptors[twice.feature]);
  keyframe->matches.push_back(
      {static_cast<std::uint16_t>(keyframe->features.size() - 1), twice.landmark});
  keyframe->matches.push_back({60000, twice.landmark});  // there is no such feature
  const int before = apply_keyframe(map, keyframe).rejected;
  EXPECT_GE(before, 2);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyKeyframe, AMatchWithAMissingLandmarkMakesItFromTheFeatureThatNamesIt) {
  const SyntheticMap world({.keyframes = 2});
  Map map;
  auto first = changed(world.keyframes[0]);
  first->matches.clear();
  apply_keyframe(map, first);
  ASSERT_TRUE(map.landmarks.empty());
  const KeyframeSummary summary = apply_keyframe(map, world.keyframes[1]);
  EXPECT_GT(summary.accepted, 50);
  EXPECT_GE(summary.created, summary.accepted);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyKeyframe, AMatchFollowsFusions) {
  const SyntheticMap world({.keyframes = 2});
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  const auto& matches = world.keyframes[1]->matches;
  const auto match = std::find_if(matches.begin(), matches.end(), [](const LandmarkMatch& m) {
    return m.landmark.creator() == KeyframeId{7, 0};
  });
  ASSERT_NE(match, matches.end());
  const Landmark old = map.landmarks.at(match->landmark);
  MapDelta delta = MapDelta::based_on(map);
  delta.removed_landmarks = {old.id};
  apply_delta(map, delta);
  delta = MapDelta::based_on(map);
  delta.new_landmarks.push_back({old.position, old.observations});
  apply_delta(map, delta);
  // As after two fusions, one after the other.
  map.replaced_landmarks.insert(old.id, {0, 900});
  map.replaced_landmarks.insert({0, 900}, {0, 1});
  EXPECT_EQ(map.resolve(old.id), (LandmarkId{0, 1}));
  apply_keyframe(map, world.keyframes[1]);
  EXPECT_EQ(map.keyframes.at({7, 1}).landmarks[match->feature], (LandmarkId{0, 1}));
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(ApplyKeyframe, WithoutSharedLandmarksTheReferenceIsTheParent) {
  const SyntheticMap world({.keyframes = 2});
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  auto keyframe = changed(world.keyframes[1]);
  keyframe->matches.clear();
  apply_keyframe(map, keyframe);
  EXPECT_EQ(map.keyframes.at(keyframe->id).parent, keyframe->reference);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(RefreshLandmark, ChoosesTheDescriptorInTheMiddle) {
  const SyntheticMap world({.keyframes = 8});
  const Map map = built(world);
  map.landmarks.for_each([&](LandmarkId, const Landmark& landmark) {
    if (landmark.observations.size() < 3) return;
    const Observation& o = landmark.observations[0];
    const auto point = static_cast<std::size_t>(world.point_of[o.keyframe.sequence][o.feature]);
    EXPECT_LE(hamming_distance(landmark.descriptor, world.descriptors[point]), 6);
  });
}

TEST(RefreshLandmark, PredictsTheOctaveThatItWasSeenAt) {
  const SyntheticMap world({.keyframes = 3, .pixel_noise = 0});
  const Map map = built(world);
  int alike = 0, all = 0;
  map.landmarks.for_each([&](LandmarkId, const Landmark& landmark) {
    for (const Observation& o : landmark.observations) {
      const KeyframeNode& node = map.keyframes.at(o.keyframe);
      const double distance = (node.map_from_camera.origin() - landmark.position).norm();
      EXPECT_GT(landmark.normal.dot((node.map_from_camera.origin() - landmark.position) / distance),
                0.95);
      const int octave = predicted_octave(landmark, distance, node.rig().pyramid);
      EXPECT_NEAR(octave, node.features().points[o.feature].octave, 1);
      alike += octave == node.features().points[o.feature].octave;
      ++all;
    }
  });
  EXPECT_GT(alike, all * 8 / 10);
}

TEST(ForgetFormer, KeepsWhatEndedLatelyAndTheWaysToIt) {
  Map map;
  constexpr std::uint64_t kNow = 20'000;
  map.keyframes_ever = kNow;
  const auto end = [&](std::uint32_t number, std::uint64_t ago) {
    map.replaced_landmarks.insert({9, number}, {{9, number + 1}, kNow - ago});
    map.removed_keyframes.insert({7, number}, {{7, number + 1}, {}, kNow - ago});
  };
  end(1, kFormerKeyframesKept + 1);
  end(2, kFormerKeyframesKept);
  end(3, kFormerLandmarksKept + 1);
  end(4, kFormerLandmarksKept);
  end(5, 0);
  forget_former(map);
  EXPECT_EQ(map.replaced_landmarks.sorted_keys(), (std::vector<LandmarkId>{{9, 4}, {9, 5}}));
  EXPECT_EQ(map.removed_keyframes.sorted_keys(),
            (std::vector<KeyframeId>{{7, 2}, {7, 3}, {7, 4}, {7, 5}}));
}

TEST(ForgetFormer, HappensWhileKeyframesArrive) {
  const SyntheticMap world({.keyframes = 2, .points = 50});
  Map map;
  map.keyframes_ever = 3'998;
  map.replaced_landmarks.insert({9, 1}, {{9, 2}, 5});
  apply_keyframe(map, world.keyframes[0]);
  EXPECT_EQ(map.replaced_landmarks.size(), 1u) << "not with every keyframe";
  apply_keyframe(map, world.keyframes[1]);
  EXPECT_EQ(map.replaced_landmarks.size(), 0u);
}

}  // namespace
}  // namespace cairn
