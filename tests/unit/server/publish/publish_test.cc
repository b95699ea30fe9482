#include "server/publish/publish.h"

#include <random>
#include <set>

#include <gtest/gtest.h>

#include "common/wire/map_update_codec.h"
#include "server/map/apply.h"
#include "server/publish/neighbourhood.h"
#include "tests/unit/server/publish/model_client.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using Kind = ClientView::Kind;

constexpr std::uint64_t kEpoch = 7;

// A map that two clients share, the view of the first one, and what that client makes of it.
struct Scene {
  explicit Scene(const PublishOptions& options = {}, int keyframes = 12)
      : world({.keyframes = keyframes, .points = 300, .epoch = kEpoch, .duplicate_share = 0.3}),
        other({.keyframes = keyframes, .points = 300, .epoch = 8, .start = 0.05}),
        view(kEpoch, options) {
    map.id = {1};
  }

  void arrive(std::size_t i) {
    client.make(*world.keyframes[i]);
    apply_keyframe(map, world.keyframes[i]);
    apply_keyframe(map, other.keyframes[i]);
    ++arrived;
  }
  void arrive_all() {
    for (std::size_t i = 0; i < world.keyframes.size(); ++i) arrive(i);
  }
  std::optional<MapUpdate> tell(Kind kind = Kind::kChanges) {
    auto update = view.difference(map, arrived, kind);
    if (update) {
      EXPECT_TRUE(wire::check_map_update(*update).ok())
          << wire::check_map_update(*update).message();
      EXPECT_TRUE(client.apply(*update));
    }
    return update;
  }
  MapDelta delta() const {
    MapDelta d;
    d.base_revision = map.revision;
    d.base_merge_epoch = map.merge_epoch;
    return d;
  }
  void move_landmark(LandmarkId id, double distance) {
    MapDelta d = delta();
    d.positions = {{id, map.landmarks.at(id).position + Eigen::Vector3d(distance, 0, 0)}};
    apply_delta(map, d);
  }
  void move_keyframe(KeyframeId id, double distance) {
    const Rigid3 old = map.keyframes.at(id).map_from_camera;
    MapDelta d = delta();
    d.poses = {{id, old, {old.rotation, old.translation + Eigen::Vector3d(distance, 0, 0)}}};
    apply_delta(map, d);
  }
  // A landmark that the client's latest keyframe sees.
  LandmarkId near_landmark() const {
    for (const LandmarkId& id : map.keyframes.at({kEpoch, arrived - 1}).landmarks)
      if (id.is_valid()) return id;
    return {};
  }

  // The client's poses and placed landmarks around it agree with the map.
  void expect_client_agrees() const {
    for (std::uint32_t s = 0; s < arrived; ++s) {
      const auto pose = client.pose_of({kEpoch, s});
      const auto truth = map.pose_of({kEpoch, s});
      ASSERT_TRUE(pose && truth) << "keyframe " << s;
      // What hangs on another keyframe moves with that one in the client and in the map, where it
      // may hang on a different one.
      const bool culled = !map.keyframes.contains({kEpoch, s});
      if (culled) continue;
      EXPECT_LT((pose->translation - truth->translation).norm(), 1.01e-4);
      EXPECT_LT(pose->rotation.angularDistance(truth->rotation), 1.01e-4);
    }
    for (const KeyframeNode* node : neighbourhood(map, {kEpoch, arrived - 1}, 30))
      for (const LandmarkId& id : node->landmarks) {
        if (!id.is_valid()) continue;
        const auto known = client.landmarks.find(id);
        ASSERT_NE(known, client.landmarks.end());
        ASSERT_TRUE(known->second.placed);
        EXPECT_LT((known->second.state.position - map.landmarks.at(id).position).norm(), 4e-3);
      }
  }

  SyntheticMap world, other;
  Map map;
  ClientView view;
  ModelClient client;
  std::uint32_t arrived = 0;
};

TEST(ClientView, StartsWithARefresh) {
  Scene scene;
  scene.arrive(0);
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  EXPECT_TRUE(update->is_refresh());
  EXPECT_EQ(update->map, scene.map.id);
  EXPECT_EQ(update->epoch, kEpoch);
  EXPECT_EQ(update->mapped_keyframes, 1u);
  ASSERT_EQ(update->keyframes.size(), 1u);
  EXPECT_EQ(update->keyframes[0].id, (KeyframeId{kEpoch, 0}));
  scene.expect_client_agrees();
}

TEST(ClientView, SaysNothingWhenNothingHasChanged) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  EXPECT_FALSE(scene.tell());
}

TEST(ClientView, TellsThatKeyframesWereMappedEvenWhenNothingMoved) {
  Scene scene;
  scene.arrive(0);
  ASSERT_TRUE(scene.view.difference(scene.map, 0));
  const auto update = scene.view.difference(scene.map, 1);
  ASSERT_TRUE(update);
  EXPECT_EQ(update->mapped_keyframes, 1u);
  EXPECT_TRUE(update->keyframes.empty());
}

TEST(ClientView, SendsOnlyWhatMovedNoticeably) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  const LandmarkId id = scene.near_landmark();
  scene.move_landmark(id, 1e-4);
  scene.move_keyframe({kEpoch, 3}, 5e-5);
  EXPECT_FALSE(scene.tell());
  scene.move_landmark(id, 0.01);
  scene.move_keyframe({kEpoch, 3}, 6e-5);  // 1.1e-4 since it was told
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  EXPECT_FALSE(update->is_refresh());
  ASSERT_EQ(update->landmarks.size(), 1u);
  EXPECT_EQ(update->landmarks[0].id, id);
  EXPECT_LE(update->landmarks[0].observers.size(), LandmarkState::kMaxObservers);
  ASSERT_EQ(update->keyframes.size(), 1u);
  EXPECT_EQ(update->keyframes[0].id.sequence, 3u);
}

TEST(ClientView, SendsNoKeyframesOfOthers) {
  Scene scene;
  scene.arrive_all();
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  for (const auto& pose : update->keyframes) EXPECT_EQ(pose.id.epoch, kEpoch);
}

TEST(ClientView, HangsCulledKeyframesOnOwnOnes) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  for (const std::uint32_t sequence : {4u, 5u, 6u})
    ASSERT_TRUE(remove_keyframe(scene.map, {kEpoch, sequence}));
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  ASSERT_EQ(update->removed_keyframes.size(), 3u);
  for (const std::uint32_t sequence : {4u, 5u, 6u}) {
    const auto pose = scene.client.pose_of({kEpoch, sequence});
    const auto truth = scene.map.pose_of({kEpoch, sequence});
    ASSERT_TRUE(pose && truth);
    EXPECT_LT((pose->translation - truth->translation).norm(), 1e-4);
  }
  EXPECT_FALSE(scene.tell());
}

TEST(ClientView, RenamesFusedLandmarksToOnesThatTheClientKnows) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  const LandmarkId from = scene.near_landmark();
  LandmarkId into;
  for (const LandmarkId& id : scene.map.keyframes.at({8, 11}).landmarks)
    if (id.is_valid() && id.origin == 8) into = id;
  MapDelta d = scene.delta();
  d.fusions = {{from, into}};
  apply_delta(scene.map, d);
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  ASSERT_EQ(update->removed_landmarks.size(), 1u);
  EXPECT_EQ(update->removed_landmarks[0].id, from);
  EXPECT_EQ(update->removed_landmarks[0].replaced_by, into);
  EXPECT_TRUE(scene.client.landmarks.contains(into));
}

TEST(ClientView, ReportsOwnLandmarksThatVanishedBeforeTheyWereEverTold) {
  Scene scene;
  scene.arrive_all();
  LandmarkId own;
  for (const LandmarkId& id : scene.map.landmarks.sorted_keys())
    if (id.origin == kEpoch) own = id;
  MapDelta d = scene.delta();
  d.removed_landmarks = {own};
  apply_delta(scene.map, d);
  ASSERT_TRUE(scene.client.landmarks.contains(own));
  scene.tell();
  EXPECT_FALSE(scene.client.landmarks.contains(own));
}

TEST(ClientView, SpreadsManyLandmarksOverSeveralUpdates) {
  Scene scene({.max_landmarks = 5});
  scene.arrive_all();
  int updates = 0;
  while (const auto update = scene.tell()) {
    EXPECT_LE(update->landmarks.size(), 5u);
    ASSERT_LT(++updates, 100);
  }
  EXPECT_GT(updates, 5);
  scene.expect_client_agrees();
}

TEST(ClientView, BoundsWhatTheClientHasToKeep) {
  Scene scene({.keyframes_around = 3, .max_known = 150}, 30);
  for (std::size_t i = 0; i < 30; ++i) {
    scene.arrive(i);
    scene.tell();
  }
  EXPECT_LE(scene.view.known_landmarks(), 300u);  // those around are kept in any case
  EXPECT_EQ(scene.client.landmarks.size(), scene.view.known_landmarks());
}

TEST(ClientView, AnotherMapMeansARefresh) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  scene.map.id = {2};
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  EXPECT_TRUE(update->is_refresh());
  scene.expect_client_agrees();
}

TEST(ClientView, NewViewOfALongRunNeedsNoHistory) {
  Scene scene;
  scene.arrive_all();
  scene.tell();
  scene.view = ClientView(kEpoch);  // the server was restarted
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  EXPECT_TRUE(update->is_refresh());
  scene.expect_client_agrees();
}

// Everything that happens to a map, at random, with updates lost on the way.
class RandomHistory : public testing::TestWithParam<unsigned> {
 protected:
  RandomHistory() : random_(GetParam()) {}

  template <typename Id>
  Id any(const std::vector<Id>& ids) {
    return ids[random_() % ids.size()];
  }
  double shift() { return std::normal_distribution<double>(0, 0.01)(random_); }

  void rework(Scene& scene) {
    const auto keyframes = scene.map.keyframes.sorted_keys();
    MapDelta d = scene.delta();
    for (int i = 0; i < 4; ++i) {
      const KeyframeId id = any(keyframes);
      const Rigid3 old = scene.map.keyframes.at(id).map_from_camera;
      Eigen::Matrix<double, 6, 1> step;
      for (int j = 0; j < 6; ++j) step[j] = shift();
      d.poses.push_back({id, old, perturbed(old, step)});
    }
    const auto landmarks = scene.map.landmarks.sorted_keys();
    for (int i = 0; i < 30; ++i)
      d.positions.push_back({any(landmarks), {shift() * 100, shift() * 100, 3 + shift()}});
    for (int i = 0; i < 6; ++i) d.fusions.push_back({any(landmarks), any(landmarks)});
    for (int i = 0; i < 6; ++i) d.removed_landmarks.push_back(any(landmarks));
    const KeyframeId culled = any(keyframes);
    if (random_() % 2 == 0 && culled.sequence + 1 < scene.arrived)
      d.removed_keyframes.push_back(culled);
    apply_delta(scene.map, d);
  }

  std::mt19937 random_;
};
INSTANTIATE_TEST_SUITE_P(Seeds, RandomHistory, testing::Range(1u, 9u));

TEST_P(RandomHistory, LeavesTheClientWithWhatTheMapSays) {
  Scene scene({}, 20);
  for (std::size_t i = 0; i < 20; ++i) {
    scene.arrive(i);
    rework(scene);
    auto update = scene.view.difference(scene.map, scene.arrived);
    if (!update || random_() % 6 == 0) continue;  // lost
    if (!scene.client.apply(*update)) scene.tell(Kind::kRefresh);
  }
  // The last one arrives; then there is nothing more to say after the round through all known ones.
  rework(scene);
  const auto update = scene.view.difference(scene.map, scene.arrived);
  if (!scene.client.apply(*update)) scene.tell(Kind::kRefresh);
  for (int i = 0; i < 3; ++i) scene.tell();
  EXPECT_FALSE(scene.tell());
  scene.expect_client_agrees();
  for (const auto& [id, known] : scene.client.landmarks)
    EXPECT_TRUE(scene.map.landmarks.contains(id)) << id.origin << " " << id.number;
}

}  // namespace
}  // namespace cairn
