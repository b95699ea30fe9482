#include "server/publish/publish.h"

#include <algorithm>
#include <map>
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
  // Time passes: another keyframe where the latest one was, that shows a few of its landmarks.
  void pass(double seconds) {
    auto keyframe = std::make_shared<Keyframe>(*map.keyframes.at({kEpoch, arrived - 1}).keyframe);
    keyframe->reference = keyframe->id;
    keyframe->reference_from_camera = {};
    keyframe->id.sequence = arrived++;
    keyframe->stamp_ns += static_cast<std::int64_t>(1e9 * seconds);
    keyframe->matches.clear();
    const auto& shown = map.keyframes.at(keyframe->reference).landmarks;
    for (std::size_t f = 0; f < shown.size() && keyframe->matches.size() < 5; ++f)
      if (shown[f].is_valid())
        keyframe->matches.push_back({static_cast<std::uint16_t>(f), shown[f]});
    apply_keyframe(map, keyframe);
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
  EXPECT_TRUE(update->landmarks.empty()) << "it looks as it did";
  ASSERT_EQ(update->moved_landmarks.size(), 1u);
  EXPECT_EQ(update->moved_landmarks[0].id, id);
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

// Of a client that started over: what it made itself it has to be told like anything else.
TEST(ClientView, NamesTheClientsOwnFeaturesInsteadOfSendingDescriptors) {
  Scene scene;
  scene.arrive_all();
  const auto update = scene.tell(Kind::kRefresh);
  ASSERT_TRUE(update);
  std::size_t named = 0;
  for (const LandmarkState& l : update->landmarks) {
    if (!l.shown_by) {
      EXPECT_EQ(l.descriptor, scene.map.landmarks.at(l.id).descriptor);
      continue;
    }
    ++named;
    const KeyframePtr& keyframe = scene.world.keyframes[l.shown_by->sequence];
    EXPECT_EQ(keyframe->features.descriptors[l.shown_by->feature],
              scene.map.landmarks.at(l.id).descriptor);
  }
  EXPECT_GT(named, update->landmarks.size() / 2);
}

TEST(ClientView, ReliesOnTheClientsFeaturesOnlyWhileItHasThem) {
  constexpr int kMany = static_cast<int>(LandmarkState::kShownByLatest) + 20;
  Scene scene({}, kMany);
  scene.arrive_all();
  const auto update = scene.tell(Kind::kRefresh);
  ASSERT_TRUE(update);
  for (const LandmarkState& l : update->landmarks)
    if (l.shown_by) {
      EXPECT_GE(l.shown_by->sequence + LandmarkState::kShownByLatest, scene.arrived);
    }
}

TEST(ClientView, DoesNotSayWhatTheClientHasMeasuredItself) {
  Scene scene;
  scene.arrive(0);
  scene.tell();  // the first one is a refresh, and tells everything
  scene.arrive(1);
  const auto update = scene.tell();
  ASSERT_TRUE(update);
  int made = 0;
  const KeyframeId second{kEpoch, 1};
  for (const LandmarkMatch& m : scene.world.keyframes[1]->matches)
    made += m.landmark.creator() == second;
  ASSERT_GT(made, 5);
  for (const LandmarkState& l : update->landmarks) EXPECT_NE(l.id.creator(), second);
  for (const LandmarkMove& l : update->moved_landmarks) EXPECT_NE(l.id.creator(), second);
  scene.expect_client_agrees();
}

TEST(ClientView, DescribesALandmarkAgainOnceItIsSeenTwiceAsOften) {
  Scene scene;
  scene.arrive(0);
  scene.tell();
  std::map<LandmarkId, std::size_t> told;
  for (std::size_t i = 1; i < 12; ++i) {
    scene.arrive(i);
    const auto update = scene.tell();
    for (const LandmarkState& l : update->landmarks) {
      const std::size_t seen = scene.map.landmarks.at(l.id).observations.size();
      if (told.contains(l.id)) {
        EXPECT_GE(seen, 2 * told[l.id]);
      }
      told[l.id] = seen;
    }
  }
}

TEST(ClientView, SpreadsManyLandmarksOverSeveralUpdates) {
  Scene scene({.bytes_per_s = 1000, .most_saved_bytes = 500});
  scene.arrive_all();
  int updates = 0;
  for (int silent = 0; silent < 3;) {
    scene.pass(0.5);
    const auto update = scene.tell();
    ASSERT_TRUE(update);
    const bool tells = !update->landmarks.empty() || !update->moved_landmarks.empty();
    silent = tells ? 0 : silent + 1;
    updates += tells;
    // Keyframes don't wait.
    EXPECT_LE(wire::encoded_bytes({}, *update), 500 + 25 * update->keyframes.size());
    ASSERT_LT(updates, 100);
  }
  EXPECT_GT(updates, 3);
  scene.expect_client_agrees();
}

TEST(ClientView, KeepsToItsBudgetInTheLongRun) {
  Scene scene({.bytes_per_s = 4000, .most_saved_bytes = 1000}, 30);
  double bytes = 0;
  for (std::size_t i = 0; i < 30; ++i) {
    scene.arrive(i);
    for (const LandmarkId& id : scene.map.landmarks.sorted_keys()) scene.move_landmark(id, 0.02);
    const auto update = scene.tell();
    ASSERT_TRUE(update);
    bytes += static_cast<double>(wire::encoded_bytes({}, *update));
  }
  const double seconds = 1e-9 * static_cast<double>(scene.world.keyframes.back()->stamp_ns);
  EXPECT_LT(bytes, 1000 + 4000 * seconds);
  EXPECT_GT(bytes, 0.8 * 4000 * seconds) << "there was more to say";
}

TEST(ClientView, TellsFirstOfWhatIsFarthestOff) {
  Scene scene({.bytes_per_s = 1e6, .most_saved_bytes = 280});
  scene.arrive_all();
  for (int i = 0; i < 60; ++i, scene.pass(1)) scene.tell();
  std::map<LandmarkId, int> rank;
  for (const LandmarkId& id : scene.map.keyframes.at({kEpoch, 11}).landmarks)
    if (id.is_valid()) rank[id] = static_cast<int>(rank.size() % 3);
  ASSERT_GT(rank.size(), 30u);
  for (const auto& [id, distance] : rank) scene.move_landmark(id, 0.003 * (1 << 2 * distance));
  scene.pass(1);
  int told = 0;
  double sum = 0;
  const auto update = scene.tell();
  for (const LandmarkMove& m : update->moved_landmarks)
    if (rank.contains(m.id)) {
      ++told;
      sum += rank[m.id];
    }
  EXPECT_GT(told, 5);
  EXPECT_LT(told, static_cast<int>(rank.size()) / 2);
  EXPECT_GT(sum / told, 1.5);
}

TEST(ClientView, SendsAMovedLandmarkAgainOnlyOnceItIsOffNoticeably) {
  Scene scene;
  scene.arrive_all();
  for (int i = 0; i < 5; ++i) scene.tell();
  const LandmarkId id = scene.near_landmark();
  // A twentieth of a pixel is 0.3 mm at 3 m and f = 500, across the line of sight.
  int told = 0;
  for (int i = 0; i < 40; ++i) {
    scene.move_landmark(id, 1e-4);
    if (const auto update = scene.tell()) told += static_cast<int>(update->moved_landmarks.size());
  }
  EXPECT_GE(told, 5);
  EXPECT_LE(told, 20);
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
