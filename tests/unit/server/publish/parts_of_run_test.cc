#include "server/publish/parts_of_run.h"

#include <gtest/gtest.h>

#include "server/map/apply.h"
#include "server/map/map_editor.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using Parts = std::vector<PartOfRun>;

// Keyframes 0 .. 3 of a run, another client's part, and keyframes 4 and 5 of the run in that.
Map two_parts() {
  const SyntheticMap own({.keyframes = 4, .epoch = 7}),
      other({.keyframes = 3, .seed = 2, .epoch = 9});
  Map map;
  for (const KeyframePtr& keyframe : own.keyframes) apply_keyframe(map, keyframe);
  for (const KeyframePtr& keyframe : other.keyframes) apply_keyframe(map, keyframe);
  for (std::uint32_t sequence : {4u, 5u}) {
    auto keyframe = std::make_shared<Keyframe>(*other.keyframes[2]);
    keyframe->id = {7, sequence};
    keyframe->reference = other.keyframes[2]->id;
    keyframe->reference_from_camera = {};
    std::erase_if(keyframe->matches, [](const LandmarkMatch& m) {
      return m.landmark.creator() == KeyframeId{9, 2};
    });
    apply_keyframe(map, keyframe);
  }
  return map;
}

TEST(PartsOfRun, ARunInOnePartIsOne) {
  EXPECT_EQ(parts_of_run(built(SyntheticMap({.keyframes = 4, .epoch = 7})), 7, 4), (Parts{{0, 0}}));
}

TEST(PartsOfRun, APartBeginsWithTheFirstKeyframeInIt) {
  const Map map = two_parts();
  EXPECT_EQ(parts_of_run(map, 7, 6), (Parts{{0, 0}, {4, 1}}));
  EXPECT_EQ(parts_of_run(map, 7, 4), (Parts{{0, 0}})) << "of so many only";
  EXPECT_EQ(parts_of_run(map, 9, 3), (Parts{{0, 0}}));
}

TEST(PartsOfRun, AMergeMakesThemOne) {
  Map map = two_parts();
  MapEditor(map).graft_tree({7, 1}, {9, 0});
  EXPECT_EQ(parts_of_run(map, 7, 6), (Parts{{0, 0}}));
}

TEST(PartsOfRun, WhatWasCulledCountsWhereItHangs) {
  Map map = two_parts();
  ASSERT_TRUE(remove_keyframe(map, {7, 3}));
  ASSERT_TRUE(remove_keyframe(map, {7, 4}));
  EXPECT_EQ(parts_of_run(map, 7, 6), (Parts{{0, 0}, {4, 1}}));
}

TEST(PartsOfRun, WhatOnlyALostMapHeldCountsToWhatCameBefore) {
  const SyntheticMap own({.keyframes = 4, .epoch = 7});
  Map map;
  apply_keyframe(map, own.keyframes[2]);
  EXPECT_EQ(parts_of_run(map, 7, 4), (Parts{{0, 0}}));
  EXPECT_EQ(parts_of_run(map, 8, 4), Parts{});
}

}  // namespace
}  // namespace cairn
