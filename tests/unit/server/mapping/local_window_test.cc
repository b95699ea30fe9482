#include "server/mapping/local_window.h"

#include <gmock/gmock.h>

#include <algorithm>

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

TEST(LocalWindow, ThinnedKeepsWhatMostSeeAndEnoughForEach) {
  const SyntheticMap world({.keyframes = 12});
  const Map map = built(world);
  const std::vector<KeyframeId> centres{kf(11)};
  const LocalWindow all = choose_local_window(map, centres, {.max_free = 5});
  const LocalWindow thin = choose_local_window(map, centres, {.max_free = 5, .landmarks_each = 30});
  EXPECT_EQ(thin.free_keyframes, all.free_keyframes);
  EXPECT_LT(thin.landmarks.size(), all.landmarks.size() / 2);
  EXPECT_TRUE(std::is_sorted(thin.landmarks.begin(), thin.landmarks.end()));
  const auto views = [&](const std::vector<LandmarkId>& landmarks) {
    double sum = 0;
    for (const LandmarkId l : landmarks)
      sum += static_cast<double>(map.landmarks.at(l).observations.size());
    return sum / static_cast<double>(landmarks.size());
  };
  EXPECT_GT(views(thin.landmarks), views(all.landmarks));
  for (const KeyframeId id : thin.free_keyframes) {
    const auto& shown = map.keyframes.at(id).landmarks;
    EXPECT_GE(std::count_if(shown.begin(), shown.end(),
                            [&](LandmarkId l) {
                              return std::binary_search(thin.landmarks.begin(),
                                                        thin.landmarks.end(), l);
                            }),
              30);
  }
}

TEST(LocalWindow, TheFreeOnesCanBeHadAlone) {
  const SyntheticMap world({.keyframes = 12});
  const Map map = built(world);
  for (const std::uint32_t centre : {2u, 6u, 11u}) {
    const std::vector<KeyframeId> centres{kf(centre)};
    EXPECT_EQ(choose_free_keyframes(map, centres, {.max_free = 6}),
              choose_local_window(map, centres, {.max_free = 6}).free_keyframes);
  }
}

TEST(LocalWindow, WithoutDepthItReachesFurtherBack) {
  const SyntheticMap world({.keyframes = 12});
  Map map;
  for (const KeyframePtr& made : world.keyframes) {
    auto keyframe = std::make_shared<Keyframe>(*made);
    auto rig = std::make_shared<Rig>(*made->rig);
    rig->sensor = Sensor::kMono;
    keyframe->rig = rig;
    apply_keyframe(map, keyframe);
  }
  const std::vector<KeyframeId> centres{kf(11)};
  EXPECT_EQ(choose_free_keyframes(built(world), centres, {.max_free = 4}).size(), 4u);
  EXPECT_EQ(choose_free_keyframes(map, centres, {.max_free = 4}).size(), 8u);
}

}  // namespace
}  // namespace cairn
