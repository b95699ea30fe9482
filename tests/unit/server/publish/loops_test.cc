// Closed loops and merged parts, from the server's map by way of its updates into a client's local
// map.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "client/tracking/local_map.h"
#include "server/map/apply.h"
#include "server/publish/publish.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

constexpr std::uint32_t kKeyframes = 5;
const Rigid3 kMove(so3_exp({0, 0.4, 0.1}), {2, 0.3, -1});
const Sim3 kScaledMove(kMove.rotation, kMove.translation, 1.6);

struct Pair {
  explicit Pair(const PublishOptions& options = {})
      : world({.keyframes = kKeyframes, .epoch = 7}), view(7, options) {
    map.id = {1};
    for (const KeyframePtr& keyframe : world.keyframes) {
      apply_keyframe(map, keyframe);
      local.add_keyframe(keyframe, keyframe->odom_from_camera.pose());
    }
    for (int i = 0; i < 100; ++i) tell();
  }
  std::size_t tell() {
    const auto update = view.difference(map, keyframes);
    if (!update) return 0;
    local.apply(*update);
    keyframes_told = update->keyframes.size();
    return update->landmarks.size() + update->moved_landmarks.size();
  }
  // Time passes: another keyframe beside the last one, that shows a few of the
  // landmarks which that one has made.
  void pass(double seconds) {
    auto keyframe = std::make_shared<Keyframe>(*map.keyframes.at({7, keyframes - 1}).keyframe);
    keyframe->reference = keyframe->id;
    keyframe->reference_from_camera = {};
    keyframe->id.sequence = keyframes++;
    keyframe->stamp_ns += static_cast<std::int64_t>(1e9 * seconds);
    keyframe->matches.clear();
    const auto& shown = map.keyframes.at(keyframe->reference).landmarks;
    for (std::size_t f = 0; f < shown.size() && keyframe->matches.size() < 5; ++f)
      if (shown[f].is_valid() && shown[f].creator() == KeyframeId{7, kKeyframes - 1})
        keyframe->matches.push_back({static_cast<std::uint16_t>(f), shown[f]});
    apply_keyframe(map, keyframe);
    local.add_keyframe(keyframe, *local.pose_of(keyframe->reference));
  }
  // The loop turns, shifts and scales every keyframe by `share` of its way along the run, its
  // landmarks with it; a merge moves all alike.
  void close_loop(bool merges, const Sim3& by = kMove, double growth = 0) {
    LoopClosure closure;
    closure.edge.query = {7, kKeyframes - 1};
    closure.edge.candidate = {7, 0};
    closure.edge.merges = merges;
    closure.edge.new_map_from_old_map = by;
    if (merges) closure.edge.moved = {7};
    closure.correction = MapDelta::based_on(map);
    for (std::uint32_t k = 0; k < keyframes; ++k) {
      const KeyframeNode& node = map.keyframes.at({7, k});
      const std::uint32_t way = std::min(k, kKeyframes - 1);
      const Sim3 move =
          merges ? by : Sim3(so3_exp({0, 0.02 * way, 0}), {0.1 * way, 0, 0}, 1 + growth * way);
      closure.correction.poses.push_back(
          {{7, k}, node.map_from_camera, move.move_pose(node.map_from_camera), move.scale});
      for (const LandmarkId id : node.landmarks)
        if (id.is_valid() && map.landmarks.at(id).reference == KeyframeId{7, k})
          closure.correction.positions.push_back({id, move * map.landmarks.at(id).position});
    }
    ASSERT_FALSE(apply_loop(map, closure).is_void);
  }
  // The farthest that any landmark of the client lies from where the map has it, metres.
  double landmark_error() const {
    double worst = 0;
    map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
      if (const LocalLandmark* mine = local.find(id))
        worst = std::max(worst, (mine->position - landmark.position).norm());
    });
    return worst;
  }
  double keyframe_error() const {
    double worst = 0;
    for (std::uint32_t k = 0; k < kKeyframes; ++k) {
      const Sim3 mine = *local.scaled_pose_of({7, k});
      const Sim3 servers = map.keyframes.at({7, k}).scaled_pose();
      worst = std::max({worst, (mine.translation - servers.translation).norm(),
                        std::abs(mine.scale / servers.scale - 1)});
    }
    return worst;
  }

  SyntheticMap world;
  Map map;
  ClientView view;
  LocalMap local;
  std::uint32_t keyframes = kKeyframes;
  std::size_t keyframes_told = 0;  // with the last update
};

TEST(Loops, AMergedPartMovesAsAWholeWithoutBeingSentAnew) {
  Pair pair;
  ASSERT_LT(pair.landmark_error(), 0.01);
  pair.close_loop(true);
  EXPECT_GT(pair.landmark_error(), 0.5);
  EXPECT_EQ(pair.tell(), 0u);
  EXPECT_LT(pair.landmark_error(), 0.01);
  EXPECT_LT(pair.keyframe_error(), 1e-3);
}

TEST(Loops, AMergedPartIsScaledAsAWholeWithoutBeingSentAnew) {
  Pair pair;
  const LandmarkId id = pair.map.landmarks.sorted_keys()[5];
  const float distance = pair.local.find(id)->max_distance;
  pair.close_loop(true, kScaledMove);
  EXPECT_GT(pair.keyframe_error(), 0.5);
  EXPECT_EQ(pair.tell(), 0u);
  EXPECT_LT(pair.landmark_error(), 0.01);
  EXPECT_LT(pair.keyframe_error(), 1e-3);
  EXPECT_NEAR(pair.local.find(id)->max_distance / distance, kScaledMove.scale, 1e-3);
  // Once more: what the server believes the client to have is that.
  EXPECT_EQ(pair.keyframes_told, 0u);
  pair.close_loop(true, kScaledMove);
  EXPECT_EQ(pair.tell(), 0u);
  EXPECT_EQ(pair.keyframes_told, 0u);
  EXPECT_LT(pair.landmark_error(), 0.02);
  EXPECT_LT(pair.keyframe_error(), 1e-3);
}

TEST(Loops, ALoopThatChangesTheScaleFromKeyframeToKeyframeReachesTheClient) {
  Pair pair({.bytes_per_s = 3000, .most_saved_bytes = 600});
  for (int i = 0; i < 40; ++i, pair.pass(1)) pair.tell();
  pair.close_loop(false, kMove, 0.05);
  const double before = pair.landmark_error();
  EXPECT_GT(pair.keyframe_error(), 0.15);
  pair.tell();
  EXPECT_LT(pair.keyframe_error(), 1e-3);
  EXPECT_LT(pair.landmark_error(), 0.6 * before);
  for (int i = 0; i < 40; ++i, pair.pass(1)) pair.tell();
  EXPECT_LT(pair.landmark_error(), 0.01);
}

TEST(Loops, WhatOneUpdateCantTellFollowsTheKeyframesAtOnce) {
  Pair pair({.bytes_per_s = 3000, .most_saved_bytes = 600});
  for (int i = 0; i < 40; ++i, pair.pass(1)) pair.tell();
  ASSERT_LT(pair.landmark_error(), 0.01);
  pair.close_loop(false);
  const double before = pair.landmark_error();
  EXPECT_GT(before, 0.3);
  EXPECT_LT(pair.tell(), 60u);
  EXPECT_LT(pair.keyframe_error(), 1e-3);
  EXPECT_LT(pair.landmark_error(), 0.6 * before);
  // And the rest is told in time.
  for (int i = 0; i < 40; ++i, pair.pass(1)) pair.tell();
  EXPECT_LT(pair.landmark_error(), 0.01);
}

TEST(Loops, APartThatStaysIsNotMoved) {
  Pair pair;
  LoopClosure closure;
  closure.edge.query = {7, 1};
  closure.edge.candidate = {7, 0};
  closure.edge.merges = true;
  closure.edge.new_map_from_old_map = Sim3(kMove);
  closure.edge.moved = {99};
  closure.correction = MapDelta::based_on(pair.map);
  ASSERT_FALSE(apply_loop(pair.map, closure).is_void);
  EXPECT_EQ(pair.tell(), 0u);
  EXPECT_LT(pair.landmark_error(), 0.01);
}

// A client that was lost has keyframes in two parts of the map, which have nothing in common: its
// first ones in a part of its own, the last one where somebody else has been.
struct TwoParts {
  TwoParts() {
    map.id = {1};
    for (const KeyframePtr& keyframe : own.keyframes)
      add(keyframe, keyframe->odom_from_camera.pose());
    for (const KeyframePtr& keyframe : others.keyframes) apply_keyframe(map, keyframe);
    found = std::make_shared<Keyframe>(*others.keyframes[2]);
    found->id = {7, kKeyframes};
    found->reference = others.keyframes[1]->id;
    found->reference_from_camera = others.keyframes[2]->reference_from_camera;
    // Landmarks that the other client has made.
    std::erase_if(found->matches, [](const LandmarkMatch& m) {
      return m.landmark.creator() == KeyframeId{9, 2};
    });
    add(found,
        (map.scaled_pose_of(found->reference).value() * found->reference_from_camera).pose());
    for (int i = 0; i < 100; ++i) tell();
  }
  void add(const KeyframePtr& keyframe, const Rigid3& pose) {
    apply_keyframe(map, keyframe);
    local.add_keyframe(keyframe, pose);
  }
  std::optional<MapUpdate> tell() {
    auto update = view.difference(map, kKeyframes + 1);
    if (update) local.apply(*update);
    return update;
  }
  // The client's own part, or else that of the other client, moves beside the one that stays.
  void merge(bool own_moves, const Sim3& by = kMove) {
    LoopClosure closure;
    closure.edge.query = {7, 0};
    closure.edge.candidate = {9, 0};
    closure.edge.merges = true;
    closure.edge.new_map_from_old_map = by;
    if (!own_moves) closure.edge.moved = {7};
    closure.edge.moved.push_back(own_moves ? 99 : 9);
    closure.edge.split = {7};
    closure.correction = MapDelta::based_on(map);
    map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
      if ((id.epoch == 7 && id.sequence < kKeyframes) != own_moves) return;
      closure.correction.poses.push_back(
          {id, node.map_from_camera, by.move_pose(node.map_from_camera), by.scale});
      for (const LandmarkId l : node.landmarks)
        if (l.is_valid() && map.landmarks.at(l).reference == id)
          closure.correction.positions.push_back({l, by * map.landmarks.at(l).position});
    });
    ASSERT_FALSE(apply_loop(map, closure).is_void);
  }
  double keyframe_error() const {
    double worst = 0;
    for (std::uint32_t k = 0; k <= kKeyframes; ++k) {
      const Sim3 mine = *local.scaled_pose_of({7, k}), servers = *map.scaled_pose_of({7, k});
      worst = std::max({worst, (mine.translation - servers.translation).norm(),
                        std::abs(mine.scale / servers.scale - 1)});
    }
    return worst;
  }
  // Of the landmarks that the client has and that some own keyframe sees.
  double landmark_error() const {
    double worst = 0;
    map.landmarks.for_each([&](LandmarkId id, const Landmark& landmark) {
      const LocalLandmark* mine = local.find(id);
      if (mine && (id.origin == 7 || id.origin == 9))
        worst = std::max(worst, (mine->position - landmark.position).norm());
    });
    return worst;
  }

  SyntheticMap own{{.keyframes = kKeyframes, .epoch = 7}};
  SyntheticMap others{{.keyframes = 4, .seed = 5, .epoch = 9}};
  std::shared_ptr<Keyframe> found;
  Map map;
  ClientView view{7};
  LocalMap local;
};

TEST(Loops, WhoHasBeenInBothPartsMovesOnlyWhatMoves) {
  for (const Sim3& by : {Sim3(kMove), kScaledMove})
    for (const bool own_moves : {true, false}) {
      TwoParts parts;
      ASSERT_LT(parts.keyframe_error(), 1e-3);
      ASSERT_LT(parts.landmark_error(), 0.01);
      parts.merge(own_moves, by);
      ASSERT_GT(parts.keyframe_error(), 0.5);
      const auto update = parts.tell();
      ASSERT_TRUE(update);
      EXPECT_EQ(update->new_map_from_old_map.has_value(), !own_moves);
      EXPECT_LT(parts.keyframe_error(), 1e-3) << own_moves;
      EXPECT_LT(parts.landmark_error(), 0.01) << own_moves;
    }
}

// What a client needs to write a trajectory: which of its keyframes are in one frame.
TEST(Loops, WhoHasBeenInTwoPartsIsToldWhichKeyframesHangTogether) {
  TwoParts parts;
  EXPECT_EQ(parts.local.parts(), (std::vector<std::uint32_t>{0, 0, 0, 0, 0, 1}));
  parts.merge(true);
  const auto update = parts.tell();
  ASSERT_TRUE(update);
  EXPECT_EQ(update->parts, (std::vector<PartOfRun>{{0, 0}}));
  EXPECT_EQ(parts.local.parts(), (std::vector<std::uint32_t>(kKeyframes + 1, 0)));
  EXPECT_FALSE(parts.tell()) << "once";
  // After a gap in the updates it is told again.
  const auto refresh = parts.view.difference(parts.map, kKeyframes + 1, ClientView::Kind::kRefresh);
  ASSERT_TRUE(refresh);
  EXPECT_EQ(refresh->parts, (std::vector<PartOfRun>{{0, 0}}));
}

TEST(Loops, ACulledKeyframeIsOfThePartThatItHangsIn) {
  TwoParts parts;
  ASSERT_TRUE(remove_keyframe(parts.map, {7, kKeyframes - 1}));
  const auto refresh = parts.view.difference(parts.map, kKeyframes + 1, ClientView::Kind::kRefresh);
  ASSERT_TRUE(refresh);
  EXPECT_EQ(refresh->parts, (std::vector<PartOfRun>{{0, 0}, {kKeyframes, 1}}));
}

TEST(Loops, WhoHasNeverBeenLostIsToldNothingOfParts) {
  Pair pair;
  for (int i = 0; i < 5; ++i, pair.pass(1))
    if (const auto update = pair.view.difference(pair.map, pair.keyframes)) {
      EXPECT_TRUE(update->parts.empty());
    }
}

// A culled keyframe hangs on one of its own part, and follows that.
TEST(Loops, ACulledKeyframeMovesWithItsPart) {
  TwoParts parts;
  ASSERT_TRUE(remove_keyframe(parts.map, {7, kKeyframes - 1}));
  ASSERT_TRUE(parts.tell());
  EXPECT_LT(parts.keyframe_error(), 1e-3);
  parts.merge(true);
  ASSERT_TRUE(parts.tell());
  EXPECT_LT(parts.keyframe_error(), 1e-3);
}

}  // namespace
}  // namespace cairn
