#include "server/mapping/neighbours.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <unordered_map>

#include "server/map/apply.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

constexpr std::uint64_t kHere = 5, kStranger = 7;

// Two runs along one way, of which a single pair of keyframes is known to show the same.
struct Met {
  SyntheticMap here{{.keyframes = 10, .epoch = kHere}};
  SyntheticMap stranger{{.keyframes = 10, .epoch = kStranger}};
  Map map;

  Met() {
    for (const auto& keyframe : here.keyframes) apply_keyframe(map, keyframe);
    for (const auto& keyframe : stranger.keyframes) apply_keyframe(map, keyframe);
    std::unordered_map<int, LandmarkId> of_point;
    const auto& shown = map.keyframes.at({kHere, 0}).landmarks;
    for (std::size_t f = 0; f < shown.size(); ++f) of_point[here.point_of[0][f]] = shown[f];
    MapDelta delta = MapDelta::based_on(map);
    const auto& also = map.keyframes.at({kStranger, 0}).landmarks;
    for (std::size_t f = 0; f < also.size() && delta.fusions.size() < 30; ++f)
      if (also[f].is_valid() && of_point.contains(stranger.point_of[0][f]))
        delta.fusions.push_back({also[f], of_point.at(stranger.point_of[0][f])});
    apply_delta(map, delta);
  }
};

int count_of(const std::vector<KeyframeId>& keyframes, std::uint64_t epoch) {
  return static_cast<int>(std::count_if(keyframes.begin(), keyframes.end(),
                                        [&](KeyframeId id) { return id.epoch == epoch; }));
}

TEST(Neighbourhood, StrangersAtTheSamePlaceBelongToIt) {
  const Met met;
  const KeyframeId newest{kStranger, 9};
  EXPECT_EQ(count_of(best_covisible(met.map, newest, 5), kHere), 0);
  const auto all = neighbourhood(met.map, newest, 5, 10);
  EXPECT_EQ(count_of({all.begin(), all.begin() + 5}, kStranger), 5);  // whom it knows, first
  EXPECT_GE(count_of(all, kHere), 4);
  EXPECT_LE(all.size(), 10u);
  EXPECT_EQ(std::count(all.begin(), all.end(), newest), 0);
}

TEST(Neighbourhood, WhatShowsSomethingElseDoesNot) {
  const SyntheticMap world({.keyframes = 10, .step = 0.8, .length = 9});
  const Map map = built(world);
  // Four metres on there is nothing in common, whoever is asked on the way.
  for (const KeyframeId id : neighbourhood(map, {7, 9}, 2, 9)) EXPECT_GE(id.sequence, 4u);
}

TEST(Neighbourhood, AKeyframeWithoutLandmarksHasItsParentAlone) {
  const SyntheticMap world({.keyframes = 3});
  Map map = built(world);
  auto blind = std::make_shared<Keyframe>(*world.keyframes[2]);
  blind->id.sequence = 3;
  blind->reference = {7, 2};
  blind->features = {};
  blind->matches.clear();
  apply_keyframe(map, blind);
  EXPECT_THAT(neighbourhood(map, {7, 3}, 5, 10), testing::ElementsAre(KeyframeId{7, 2}));
}

}  // namespace
}  // namespace cairn
