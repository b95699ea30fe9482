#include "server/map/loop.h"

#include <gmock/gmock.h>

#include "server/map/apply.h"
#include "server/map/connected.h"
#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

KeyframeId kf(std::uint32_t sequence, std::uint64_t epoch = 7) {
  return {epoch, sequence};
}

// Two clients that pass the same points and do not know of each other.
struct TwoParts {
  SyntheticMap first{{.keyframes = 4, .epoch = 7}};
  SyntheticMap second{{.keyframes = 4, .epoch = 8}};
  Map map = built(first);
  TwoParts() {
    for (const KeyframePtr& keyframe : second.keyframes) apply_keyframe(map, keyframe);
  }

  // Moves the second part, and fuses `fused` landmarks that show the same points.
  LoopClosure closure(const Rigid3& move, std::size_t fused) const {
    LoopClosure c;
    c.edge.query = kf(2, 8);
    c.edge.candidate = kf(2, 7);
    c.edge.inliers = 50;
    c.edge.merges = true;
    c.edge.new_map_from_old_map = Sim3(move);
    c.edge.moved = {8};
    c.correction = MapDelta::based_on(map);
    for (std::uint32_t k = 0; k < 4; ++k) {
      const Rigid3& old = map.keyframes.at(kf(k, 8)).map_from_camera;
      c.correction.poses.push_back({kf(k, 8), old, move * old});
    }
    const KeyframeNode& a = map.keyframes.at(kf(2, 7));
    const KeyframeNode& b = map.keyframes.at(kf(2, 8));
    for (std::size_t f = 0; f < b.landmarks.size() && fused > 0; ++f)
      for (std::size_t g = 0; g < a.landmarks.size(); ++g)
        if (second.point_of[2][f] == first.point_of[2][g] && b.landmarks[f].is_valid() &&
            a.landmarks[g].is_valid()) {
          c.correction.fusions.push_back({b.landmarks[f], a.landmarks[g]});
          --fused;
          break;
        }
    return c;
  }
};

const Rigid3 kMove(so3_exp({0, 0.3, 0}), {1, 0, -0.5});

TEST(ConnectedKeyframes, ClientsThatHaveNotMetAreApart) {
  const TwoParts parts;
  EXPECT_THAT(connected_keyframes(parts.map, kf(1, 7)),
              ElementsAre(kf(0, 7), kf(1, 7), kf(2, 7), kf(3, 7)));
  EXPECT_THAT(connected_keyframes(parts.map, kf(3, 8)), SizeIs(4));
  EXPECT_THAT(connected_keyframes(parts.map, kf(3, 9)), IsEmpty());
}

TEST(ApplyLoop, MovesAPartFusesItAndRemembersTheEdge) {
  TwoParts parts;
  const Rigid3 before = parts.map.keyframes.at(kf(3, 8)).map_from_camera;
  const DeltaSummary summary = apply_loop(parts.map, parts.closure(kMove, 20));
  EXPECT_FALSE(summary.is_void);
  EXPECT_EQ(summary.fused, 20);
  EXPECT_EQ(parts.map.keyframes.at(kf(3, 8)).map_from_camera.matrix(), (kMove * before).matrix());
  EXPECT_EQ(parts.map.merge_epoch, 1u);
  ASSERT_THAT(parts.map.loops, SizeIs(1));
  EXPECT_EQ(parts.map.loops[0].inliers, 50);
  EXPECT_THAT(connected_keyframes(parts.map, kf(0, 7)), SizeIs(8));
  EXPECT_THAT(check_invariants(parts.map), IsEmpty());
}

TEST(ApplyLoop, ConnectsEvenWhatSharesNoLandmark) {
  TwoParts parts;
  apply_loop(parts.map, parts.closure(kMove, 0));
  EXPECT_THAT(connected_keyframes(parts.map, kf(0, 7)), SizeIs(8));
}

std::vector<KeyframeId> roots(const Map& map) {
  std::vector<KeyframeId> found;
  for (const KeyframeId id : map.keyframes.sorted_keys())
    if (!map.keyframes.at(id).parent.is_valid()) found.push_back(id);
  return found;
}

TEST(ApplyLoop, ThePartThatMovedHangsOnTheOther) {
  TwoParts parts;
  EXPECT_THAT(roots(parts.map), ElementsAre(kf(0, 7), kf(0, 8)));
  apply_loop(parts.map, parts.closure(kMove, 20));
  EXPECT_THAT(roots(parts.map), ElementsAre(kf(0, 7)));
  EXPECT_EQ(parts.map.keyframes.at(kf(2, 8)).parent, kf(2, 7)) << "where they met";
  EXPECT_TRUE(parts.map.keyframes.at(kf(0, 8)).parent.is_valid()) << "the former root";
  EXPECT_THAT(check_invariants(parts.map), IsEmpty());
}

TEST(ApplyLoop, ALoopLeavesTheTreeAsItIs) {
  TwoParts parts;
  apply_loop(parts.map, parts.closure(kMove, 20));
  LoopClosure loop = parts.closure(kMove, 0);
  loop.edge.merges = true;  // and still there is nothing to graft within one tree
  const KeyframeId parent = parts.map.keyframes.at(kf(3, 8)).parent;
  EXPECT_FALSE(apply_loop(parts.map, loop).is_void);
  EXPECT_EQ(parts.map.keyframes.at(kf(3, 8)).parent, parent);
  EXPECT_THAT(check_invariants(parts.map), IsEmpty());
}

TEST(ApplyLoop, WhatArrivedSinceMovesAlong) {
  const SyntheticMap world({.keyframes = 6});
  Map map = built(world, 5);
  LoopClosure closure;
  closure.edge.query = kf(4);
  closure.edge.candidate = kf(0);
  closure.correction = MapDelta::based_on(map);
  const Rigid3 old = map.keyframes.at(kf(4)).map_from_camera;
  closure.correction.poses.push_back({kf(4), old, kMove * old});
  apply_keyframe(map, world.keyframes[5]);
  const Rigid3 relative = old.inverse() * map.keyframes.at(kf(5)).map_from_camera;
  EXPECT_GT(apply_loop(map, closure).carried, 0);
  const Rigid3 now =
      map.keyframes.at(kf(4)).map_from_camera.inverse() * map.keyframes.at(kf(5)).map_from_camera;
  EXPECT_LT((now.translation - relative.translation).norm(), 1e-9);
}

TEST(ApplyLoop, WhatWasComputedBeforeIsVoid) {
  TwoParts parts;
  MapDelta stale = MapDelta::based_on(parts.map);
  stale.poses.push_back({kf(1, 7), {}, kMove});
  const LoopClosure again = parts.closure(kMove, 5);
  apply_loop(parts.map, parts.closure(kMove, 5));
  EXPECT_TRUE(apply_delta(parts.map, stale).is_void);
  EXPECT_TRUE(apply_loop(parts.map, again).is_void);
  EXPECT_EQ(parts.map.merge_epoch, 1u);
  EXPECT_THAT(parts.map.loops, SizeIs(1));
}

TEST(ApplyLoop, TheEdgeOfACulledKeyframeGoesOnFromItsAnchor) {
  TwoParts parts;
  apply_loop(parts.map, parts.closure(kMove, 20));
  LoopEdge& edge = parts.map.loops[0];
  edge.candidate_from_query =
      Sim3(parts.map.keyframes.at(edge.candidate).map_from_camera.inverse() *
           parts.map.keyframes.at(edge.query).map_from_camera);
  ASSERT_TRUE(remove_keyframe(parts.map, kf(2, 7)));
  const LoopEdge& moved = parts.map.loops[0];
  EXPECT_NE(moved.candidate, kf(2, 7));
  ASSERT_TRUE(parts.map.keyframes.contains(moved.candidate));
  const Rigid3 expected = parts.map.keyframes.at(moved.candidate).map_from_camera.inverse() *
                          parts.map.keyframes.at(moved.query).map_from_camera;
  const Rigid3 held = moved.candidate_from_query.move_pose(Rigid3());
  EXPECT_LT((held.translation - expected.translation).norm(), 1e-9);
  EXPECT_LT(held.rotation.angularDistance(expected.rotation), 1e-9);
}

TEST(ApplyLoop, NothingIsClosedWhenAKeyframeIsGone) {
  TwoParts parts;
  LoopClosure closure = parts.closure(kMove, 5);
  closure.edge.candidate = kf(77);
  EXPECT_TRUE(apply_loop(parts.map, closure).is_void);
  EXPECT_EQ(parts.map.merge_epoch, 0u);
}

}  // namespace
}  // namespace cairn
