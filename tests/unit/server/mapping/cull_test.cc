#include "server/mapping/cull.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::Contains;
using testing::IsEmpty;
using testing::Not;

KeyframeId kf(std::uint32_t sequence) {
  return {7, sequence};
}

// All its keyframes have been through local mapping.
Map mapped(Map map) {
  MapDelta delta = MapDelta::based_on(map);
  delta.mapped_keyframes = map.keyframes.sorted_keys();
  apply_delta(map, delta);
  return map;
}

TEST(CullLandmarks, ThoseThatNobodyElseSawGoAfterTheirGrace) {
  const SyntheticMap world({.keyframes = 6, .report_share = 0.6});
  Map map = built(world);
  MapDelta delta = MapDelta::based_on(map);
  delta.removed_landmarks = landmarks_failing_trial(map, kf(5));
  EXPECT_FALSE(delta.removed_landmarks.empty());
  for (const LandmarkId id : delta.removed_landmarks) {
    const Landmark& landmark = map.landmarks.at(id);
    EXPECT_EQ(landmark.observations.size(), 1u);
    EXPECT_TRUE(landmark.reference == kf(2) || landmark.reference == kf(3));
  }
  map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
    const bool young = landmark.reference == kf(4) || landmark.reference == kf(5);
    if (young || landmark.observations.size() >= 2) {
      EXPECT_THAT(delta.removed_landmarks, Not(Contains(id)));
    }
  });
  apply_delta(map, delta);
  EXPECT_THAT(check_invariants(map), IsEmpty());
}

TEST(CullLandmarks, ThoseRarelyFoundGo) {
  const SyntheticMap world({.keyframes = 3});
  Map map = built(world);
  std::vector<LandmarkId> of_last;
  map.landmarks.for_each([&](LandmarkId id, const Landmark& l) {
    if (l.reference == kf(1) && l.observations.size() > 1) of_last.push_back(id);
  });
  ASSERT_GE(of_last.size(), 2u);
  MapDelta sightings = MapDelta::based_on(map);
  sightings.sightings = {{of_last[0], 9, 1}, {of_last[1], 3, 1}};  // 2 of 10, 2 of 4
  apply_delta(map, sightings);
  const std::vector<LandmarkId> failing = landmarks_failing_trial(map, kf(2));
  EXPECT_THAT(failing, Contains(of_last[0]));
  EXPECT_THAT(failing, Not(Contains(of_last[1])));
  // One that many have seen has long had its trial, whatever its reference.
  CullOptions options;
  options.proven = map.landmarks.at(of_last[0]).observations.size();
  EXPECT_THAT(landmarks_failing_trial(map, kf(2), options), Not(Contains(of_last[0])));
}

TEST(CullKeyframes, ThoseThatSayNothingNewGoButNotTheNewestNorRoots) {
  const SyntheticMap world({.keyframes = 14, .step = 0.01});  // hardly moves
  Map map = mapped(built(world));
  const MapDelta delta = cull_keyframes(map, {kf(13)});
  EXPECT_GE(delta.removed_keyframes.size(), 5u);
  for (const KeyframeId id : delta.removed_keyframes) {
    EXPECT_NE(id, kf(0));
    EXPECT_LE(id.sequence, 10u);
  }
  apply_delta(map, delta);
  EXPECT_THAT(check_invariants(map), IsEmpty());
  // What is left has landmarks of its own or is needed by others: nothing more goes.
  EXPECT_THAT(cull_keyframes(map, {kf(13)}).removed_keyframes, IsEmpty());
}

TEST(CullKeyframes, WhereAllIsFarAwayItCountsToo) {
  const SyntheticMap world({.keyframes = 14, .step = 0.01});
  Map map = mapped(built(world));
  for (const KeyframeId id : map.keyframes.sorted_keys()) {
    KeyframeNode& node = *map.keyframes.edit(id);
    auto rig = std::make_shared<Rig>(node.rig());
    rig->max_depth = 0.1;
    auto keyframe = std::make_shared<Keyframe>(*node.keyframe);
    keyframe->rig = rig;
    node.keyframe = keyframe;
  }
  EXPECT_GE(cull_keyframes(map, {kf(13)}).removed_keyframes.size(), 5u);
}

TEST(CullKeyframes, WhatHasNotBeenAdjustedStays) {
  const SyntheticMap world({.keyframes = 14, .step = 0.01});
  Map map = built(world);
  EXPECT_THAT(cull_keyframes(map, {kf(13)}).removed_keyframes, IsEmpty());
  MapDelta delta = MapDelta::based_on(map);
  delta.mapped_keyframes = {kf(4)};
  apply_delta(map, delta);
  const MapDelta culled = cull_keyframes(map, {kf(13)});
  EXPECT_THAT(culled.removed_keyframes, Not(IsEmpty()));
  for (const KeyframeId id : culled.removed_keyframes) EXPECT_LE(id.sequence, 4u);
}

TEST(CullKeyframes, EveryLandmarkThatWasSeenOftenStaysSo) {
  const SyntheticMap world({.keyframes = 14, .step = 0.01});
  Map map = mapped(built(world));
  const Map before = map;
  apply_delta(map, cull_keyframes(map, {kf(13)}));
  int often = 0, kept = 0;
  before.landmarks.for_each([&](LandmarkId id, const Landmark& l) {
    if (l.observations.size() < 4) return;
    ++often;
    const Landmark* now = map.landmarks.find(id);
    kept += now && now->observations.size() >= 3;
  });
  EXPECT_GT(often, 50);
  EXPECT_GE(kept, often * 8 / 10);  // each removal may cost a tenth of its own
}

TEST(CullKeyframes, AKeyframeWithSightsOfItsOwnStays) {
  const SyntheticMap world({.keyframes = 8, .step = 1.2, .length = 9.0});
  const Map map = mapped(built(world));
  EXPECT_THAT(cull_keyframes(map, {kf(7)}).removed_keyframes, IsEmpty());
}

TEST(CullKeyframes, CoarserViewsDoNotReplaceAFinerOne) {
  const SyntheticMap world({.keyframes = 9, .step = 0.01});
  Map map;
  for (std::size_t k = 0; k < 9; ++k) {
    auto keyframe = std::make_shared<Keyframe>(*world.keyframes[k]);
    for (Feature& f : keyframe->features.points) f.octave = k == 4 ? 1 : 3;
    apply_keyframe(map, keyframe);
  }
  map = mapped(std::move(map));
  const auto removed = cull_keyframes(map, {kf(8)}).removed_keyframes;
  EXPECT_THAT(removed, Not(Contains(kf(4))));
  EXPECT_GE(removed.size(), 2u);
}

TEST(CullKeyframes, TheNewestOfAClientThatIsGoneMayGo) {
  const SyntheticMap gone({.keyframes = 8, .epoch = 5, .step = 0.01});
  const SyntheticMap here({.keyframes = 8, .epoch = 7, .step = 0.01});
  Map map;
  for (const auto& keyframe : gone.keyframes) apply_keyframe(map, keyframe);
  for (const auto& keyframe : here.keyframes) apply_keyframe(map, keyframe);
  map = mapped(std::move(map));
  const auto of_gone = [](const MapDelta& delta) {
    return std::count_if(delta.removed_keyframes.begin(), delta.removed_keyframes.end(),
                         [](KeyframeId id) {
                           return id == KeyframeId{5, 5};
                         });
  };
  EXPECT_EQ(of_gone(cull_keyframes(map, {{5, 0}})), 0);
  map.revision += 5001;
  EXPECT_GT(of_gone(cull_keyframes(map, {{5, 0}})), 0);
}

TEST(CullKeyframes, SeveralNeighbourhoodsAtOnceLoseEachKeyframeOnce) {
  const SyntheticMap world({.keyframes = 14, .step = 0.01});
  Map map = mapped(built(world));
  const MapDelta delta = cull_keyframes(map, {kf(12), kf(13)});
  EXPECT_THAT(delta.removed_keyframes, Not(IsEmpty()));
  EXPECT_THAT(delta.removed_keyframes, Not(Contains(kf(12))));
  const std::set<KeyframeId> different(delta.removed_keyframes.begin(),
                                       delta.removed_keyframes.end());
  EXPECT_EQ(different.size(), delta.removed_keyframes.size());
}

TEST(CullKeyframes, AFullMapAsksMoreOfAKeyframe) {
  const SyntheticMap world({.keyframes = 10});
  const Map map = mapped(built(world));
  const KeyframeNode& any = map.keyframes.at(kf(5));
  const CullOptions roomy;
  EXPECT_EQ(redundant_share(map, any, roomy), roomy.redundant_share);
  EXPECT_EQ(redundant_share(map, any, {.keyframe_budget = 10}), roomy.redundant_share);
  EXPECT_NEAR(redundant_share(map, any, {.keyframe_budget = 9}), 0.9 - 0.3 * 5 / 9, 1e-9);
  EXPECT_EQ(redundant_share(map, any, {.keyframe_budget = 5}), roomy.full_share);
  EXPECT_EQ(redundant_share(map, any, {.landmark_budget = 10}), roomy.full_share);
}

TEST(CullKeyframes, ACrowdAsksMoreOfEachOfIt) {
  const SyntheticMap world({.keyframes = 10, .step = 0.01});  // all show the same
  const Map map = mapped(built(world));
  const KeyframeNode& any = map.keyframes.at(kf(5));
  ASSERT_EQ(any.covisible.size(), 9u);
  EXPECT_EQ(redundant_share(map, any, {.crowd = 9}), 0.9);
  EXPECT_NEAR(redundant_share(map, any, {.crowd = 6}), 0.9 - 0.3 / 2, 1e-9);
  EXPECT_NEAR(redundant_share(map, any, {.crowd = 4}), 0.6, 1e-9);
  // Those that show less of the same make no crowd.
  EXPECT_EQ(redundant_share(map, any, {.crowd = 4, .crowd_overlap = 1.1}), 0.9);
}

}  // namespace
}  // namespace cairn
