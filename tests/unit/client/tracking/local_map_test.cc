#include "client/tracking/local_map.h"

#include <gtest/gtest.h>

#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

constexpr std::uint64_t kEpoch = 7;

// A keyframe that makes a landmark of each of its first `own` features and matches `others`.
KeyframePtr make_keyframe(std::uint32_t sequence, int own, std::vector<LandmarkId> others = {},
                          const Rigid3& reference_from_camera = {}) {
  auto k = std::make_shared<Keyframe>();
  k->id = {kEpoch, sequence};
  k->rig = testing::test_rig();
  if (sequence > 0) k->reference = {kEpoch, sequence - 1};
  k->reference_from_camera = reference_from_camera;
  for (int i = 0; i < own + static_cast<int>(others.size()); ++i) {
    Feature f;
    f.x = static_cast<float>(100 + 10 * i);
    f.y = 200;
    f.disparity = 20;
    k->features.points.push_back(f);
    k->features.descriptors.push_back({static_cast<std::uint64_t>(i), sequence, 0, 0});
    const auto feature = static_cast<std::uint16_t>(i);
    k->matches.push_back({feature, i < own ? LandmarkId::from_feature(k->id, feature)
                                           : others[static_cast<std::size_t>(i - own)]});
  }
  return k;
}

LandmarkId name(std::uint32_t sequence, std::uint16_t feature) {
  return LandmarkId::from_feature({kEpoch, sequence}, feature);
}

Rigid3 moved(double x, double y = 0, double z = 0) {
  return {Eigen::Quaterniond::Identity(), {x, y, z}};
}

MapUpdate update_of(std::uint32_t mapped) {
  MapUpdate u;
  u.base_revision = 1;
  u.revision = 2;
  u.epoch = kEpoch;
  u.mapped_keyframes = mapped;
  return u;
}

TEST(LocalMap, MakesProvisionalLandmarksFromDepth) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 3), moved(1));
  ASSERT_EQ(map.landmark_count(), 3u);
  const LocalLandmark* l = map.find(name(0, 0));
  ASSERT_TRUE(l);
  // Disparity 20 px with 525 px * 0.075 m: depth 1.96875 m; x = (100 - 319.5) / 525 * depth + 1.
  EXPECT_NEAR(l->position.z(), 1.96875, 1e-9);
  EXPECT_NEAR(l->position.x(), (100 - 319.5) / 525 * 1.96875 + 1, 1e-9);
}

TEST(LocalMap, FindsWhatNeighbouringKeyframesSee) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 5), moved(0));
  map.add_keyframe(make_keyframe(1, 5, {name(0, 4)}), moved(0));
  map.add_keyframe(make_keyframe(2, 5), moved(0));  // shares nothing
  const std::vector<LandmarkId> seen{name(0, 0), name(0, 4)};
  EXPECT_EQ(map.around(seen, 10).size(), 10u);  // both keyframes' landmarks, each once
  EXPECT_EQ(map.around(seen, 1).size(), 5u);
  EXPECT_EQ(map.most_shared(seen), (KeyframeId{kEpoch, 0}));
}

TEST(LocalMap, MovesProvisionalLandmarksWithTheirKeyframe) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  const Eigen::Vector3d before = map.find(name(0, 0))->position;
  MapUpdate u = update_of(0);
  u.keyframes.push_back({{kEpoch, 0}, moved(0.5)});
  map.apply(u);
  EXPECT_NEAR((map.find(name(0, 0))->position - before - Eigen::Vector3d(0.5, 0, 0)).norm(), 0,
              1e-12);
}

TEST(LocalMap, CarriesKeyframesThatTheServerHasNotPlacedYet) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  map.add_keyframe(make_keyframe(1, 1, {}, moved(0.1)), moved(0.1));
  map.add_keyframe(make_keyframe(2, 1, {}, moved(0.1)), moved(0.2));
  MapUpdate u = update_of(2);
  u.keyframes.push_back({{kEpoch, 1}, moved(1.1)});
  map.apply(u);
  EXPECT_NEAR(map.pose_of({kEpoch, 0})->translation.x(), 0, 1e-12);
  EXPECT_NEAR(map.pose_of({kEpoch, 1})->translation.x(), 1.1, 1e-12);
  EXPECT_NEAR(map.pose_of({kEpoch, 2})->translation.x(), 1.2, 1e-12);
}

TEST(LocalMap, TakesTheServersPositionsAndNewLandmarks) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  MapUpdate u = update_of(1);
  LandmarkState known;
  known.id = name(0, 0);
  known.position = {1, 2, 3};
  LandmarkState made;
  made.id = {LandmarkId::kServer, 5};
  made.observers = {{kEpoch, 0}};
  u.landmarks = {known, made};
  map.apply(u);
  EXPECT_EQ(map.find(name(0, 0))->position, Eigen::Vector3d(1, 2, 3));
  const std::vector<LandmarkId> seen{name(0, 0)};
  EXPECT_EQ(map.around(seen, 5).size(), 2u);
}

TEST(LocalMap, ALandmarkThatMovedKeepsWhatItLooksLike) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 2), moved(0));
  const LocalLandmark before = *map.find(name(0, 1));
  MapUpdate u = update_of(0);
  u.moved_landmarks = {{name(0, 1), {1, 2, 3}}, {{LandmarkId::kServer, 9}, {4, 5, 6}}};
  map.apply(u);
  const LocalLandmark* after = map.find(name(0, 1));
  EXPECT_EQ(after->position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(after->descriptor, before.descriptor);
  EXPECT_EQ(after->normal, before.normal);
  EXPECT_EQ(after->observers, before.observers);
  EXPECT_FALSE(map.find({LandmarkId::kServer, 9})) << "it says not enough of one that is unknown";
  // Told by the server, it no longer moves with its keyframe.
  u.moved_landmarks.clear();
  u.keyframes = {{{kEpoch, 0}, moved(0.5)}};
  map.apply(u);
  EXPECT_EQ(map.find(name(0, 1))->position, Eigen::Vector3d(1, 2, 3));
}

TEST(LocalMap, LooksUpWhatItsOwnFeaturesShow) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 3), moved(0));
  map.add_keyframe(make_keyframe(1, 3), moved(0));
  MapUpdate u = update_of(2);
  LandmarkState made;
  made.id = {LandmarkId::kServer, 5};
  made.shown_by = OwnFeature{1, 2};
  LandmarkState known;
  known.id = name(0, 0);
  known.position = {7, 8, 9};
  known.shown_by = OwnFeature{1, 1};
  u.landmarks = {made, known};
  map.apply(u);
  ASSERT_TRUE(map.find(made.id));
  EXPECT_EQ(map.find(made.id)->descriptor, (Descriptor{2, 1, 0, 0}));
  EXPECT_EQ(map.find(known.id)->descriptor, (Descriptor{1, 1, 0, 0}));
}

TEST(LocalMap, WithoutTheFeatureAKnownLandmarkKeepsItsLooksAndANewOneIsLeftOut) {
  LocalMap map({.keyframes_with_features = 1, .unmapped_with_features = 0});
  map.add_keyframe(make_keyframe(0, 3), moved(0));
  map.add_keyframe(make_keyframe(1, 3), moved(0));  // lets the first one's features go
  for (const OwnFeature feature : {OwnFeature{0, 1}, OwnFeature{1, 77}, OwnFeature{9, 0}}) {
    MapUpdate u = update_of(2);
    LandmarkState made, known;
    made.id = {LandmarkId::kServer, 5};
    made.shown_by = known.shown_by = feature;
    known.id = name(1, 0);
    known.position = {7, 8, 9};
    u.landmarks = {made, known};
    map.apply(u);
    EXPECT_FALSE(map.find(made.id));
    EXPECT_EQ(map.find(known.id)->descriptor, (Descriptor{0, 1, 0, 0}));
    EXPECT_EQ(map.find(known.id)->position, Eigen::Vector3d(7, 8, 9));
  }
}

TEST(LocalMap, KeepsFeaturesOfKeyframesThatAreNotMappedYet) {
  LocalMap map({.keyframes_with_features = 2, .unmapped_with_features = 3});
  const auto shows = [&](std::uint32_t sequence, std::uint32_t mapped) {
    MapUpdate u = update_of(mapped);
    LandmarkState made;
    made.id = {LandmarkId::kServer, 100 * mapped + sequence + 1};
    made.shown_by = OwnFeature{sequence, 0};
    u.landmarks = {made};
    map.apply(u);
    return map.find(made.id) != nullptr;
  };
  for (std::uint32_t i = 0; i < 4; ++i) map.add_keyframe(make_keyframe(i, 1), moved(0));
  EXPECT_TRUE(shows(0, 0));  // two, and three more that wait
  EXPECT_TRUE(shows(1, 2));  // two wait still
  EXPECT_TRUE(shows(1, 3));
  EXPECT_FALSE(shows(1, 4));
  EXPECT_TRUE(shows(2, 4));
  for (std::uint32_t i = 4; i < 30; ++i) map.add_keyframe(make_keyframe(i, 1), moved(0));
  EXPECT_FALSE(shows(24, 4)) << "however many wait, there is a limit";
  EXPECT_TRUE(shows(25, 4));
  EXPECT_EQ(map.recent_keyframes().size(), 2u);
}

TEST(LocalMap, ForgetsTheOldestOfFormerNames) {
  LocalMap map({.former_names = 2});
  map.add_keyframe(make_keyframe(0, 5), moved(0));
  for (std::uint16_t i = 0; i < 4; ++i) {
    MapUpdate u = update_of(1);
    u.removed_landmarks = {{name(0, i), name(0, 4)}};
    map.apply(u);
  }
  EXPECT_FALSE(map.find(name(0, 1)));
  EXPECT_TRUE(map.find(name(0, 2)));
  EXPECT_TRUE(map.find(name(0, 3)));
}

TEST(LocalMap, FollowsRenamingsAndForgetsWhatIsGone) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 3), moved(0));
  MapUpdate u = update_of(1);
  u.removed_landmarks.push_back({name(0, 0), name(0, 1)});
  u.removed_landmarks.push_back({name(0, 2), std::nullopt});
  map.apply(u);
  ASSERT_TRUE(map.find(name(0, 0)));
  EXPECT_EQ(map.find(name(0, 0))->id, name(0, 1));
  EXPECT_FALSE(map.find(name(0, 2)));
  EXPECT_EQ(map.landmark_count(), 1u);
}

TEST(LocalMap, IsNotTrappedByRenamingsInACircle) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 2), moved(0));
  MapUpdate u = update_of(1);
  u.removed_landmarks.push_back({name(0, 0), name(0, 1)});
  u.removed_landmarks.push_back({name(0, 1), name(0, 0)});
  u.removed_landmarks.push_back({name(0, 1), name(0, 1)});
  map.apply(u);
  EXPECT_TRUE(map.find(name(0, 0)));
}

TEST(LocalMap, HangsRemovedKeyframesOnTheirAnchor) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  map.add_keyframe(make_keyframe(1, 1, {}, moved(0.1)), moved(0.1));
  map.add_keyframe(make_keyframe(2, 1, {}, moved(0.1)), moved(0.2));
  MapUpdate u = update_of(3);
  u.keyframes = {{{kEpoch, 0}, moved(0)}, {{kEpoch, 1}, moved(0.1)}, {{kEpoch, 2}, moved(0.2)}};
  u.removed_keyframes.push_back({{kEpoch, 1}, {kEpoch, 2}, moved(-0.1)});
  map.apply(u);
  MapUpdate later = update_of(3);
  later.keyframes = {{{kEpoch, 2}, moved(5)}};
  map.apply(later);
  EXPECT_NEAR(map.pose_of({kEpoch, 1})->translation.x(), 4.9, 1e-12);
}

TEST(LocalMap, AChainOfRemovedKeyframesHangsOnItsEndHoweverLong) {
  constexpr std::uint32_t kLast = 3000;
  LocalMap map;
  MapUpdate u = update_of(kLast + 1);
  for (std::uint32_t i = 0; i <= kLast; ++i) {
    map.add_keyframe(make_keyframe(i, 0), moved(0.1 * i));
    if (i < kLast) u.removed_keyframes.push_back({{kEpoch, i}, {kEpoch, i + 1}, moved(-0.1)});
  }
  u.keyframes = {{{kEpoch, kLast}, moved(0.1 * kLast)}};
  map.apply(u);
  MapUpdate later = update_of(kLast + 1);
  later.keyframes = {{{kEpoch, kLast}, moved(1000)}};
  map.apply(later);
  EXPECT_NEAR(map.pose_of({kEpoch, 0})->translation.x(), 1000 - 0.1 * kLast, 1e-6);
}

TEST(LocalMap, ViewsOfCulledKeyframesDoNotAddUp) {
  constexpr std::uint32_t kViews = 30;
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  MapUpdate u = update_of(kViews);
  u.keyframes = {{{kEpoch, 0}, moved(0)}};
  for (std::uint32_t i = 1; i < kViews; ++i) {
    map.add_keyframe(make_keyframe(i, 0, {name(0, 0)}), moved(0));
    if (i < kViews - 1) u.removed_keyframes.push_back({{kEpoch, i}, {kEpoch, 0}, moved(0)});
  }
  EXPECT_EQ(map.find(name(0, 0))->observers.size(), kViews);
  map.apply(u);
  EXPECT_EQ(map.find(name(0, 0))->observers.size(), 8u) << "enough to lead there";
  EXPECT_EQ(map.landmarks_of({kEpoch, 0}), 1);
  EXPECT_EQ(map.landmarks_of({kEpoch, kViews - 1}), 1);
  EXPECT_EQ(map.landmarks_of({kEpoch, 1}), 0);
}

TEST(LocalMap, ARefreshReplacesWhatTheServerSaidBefore) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  MapUpdate first = update_of(0);
  LandmarkState made;
  made.id = {LandmarkId::kServer, 5};
  first.landmarks = {made};
  map.apply(first);
  MapUpdate refresh = update_of(0);
  refresh.base_revision = 0;
  map.apply(refresh);
  EXPECT_FALSE(map.find(made.id));
  EXPECT_TRUE(map.find(name(0, 0))) << "provisional landmarks are the client's own";
  refresh.mapped_keyframes = 1;  // and it has been mapped, and culled, since
  map.apply(refresh);
  EXPECT_FALSE(map.find(name(0, 0)));
}

// What the server has mapped comes in another frame after its restart.
TEST(LocalMap, AnotherMapKeepsThePlacesOfWhatItDoesNotHold) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  map.add_keyframe(make_keyframe(1, 1, {}, moved(0.1)), moved(0.1));
  MapUpdate first = update_of(2);
  first.map = {1};
  first.keyframes = {{{kEpoch, 0}, moved(5)}, {{kEpoch, 1}, moved(5.1)}};
  LandmarkState made;
  made.id = {LandmarkId::kServer, 5};
  made.observers = {{kEpoch, 0}};
  first.landmarks = {made};
  EXPECT_FALSE(map.is_of_another_map(first)) << "there was none before";
  map.apply(first);
  map.add_keyframe(make_keyframe(2, 1, {}, moved(0.1)), moved(5.2));
  const Eigen::Vector3d seen = map.find(name(0, 0))->position;

  MapUpdate other = update_of(0);
  other.base_revision = 0;
  other.map = {2};
  ASSERT_TRUE(map.is_of_another_map(other));
  const NewNames names = map.change_map(moved(-5));
  map.apply(other);
  EXPECT_EQ(map.id(), MapId{2});
  EXPECT_NEAR(map.pose_of({kEpoch, 0})->translation.x(), 0, 1e-12);
  EXPECT_NEAR(map.pose_of({kEpoch, 2})->translation.x(), 0.2, 1e-12);
  ASSERT_TRUE(map.find(name(0, 0)));
  EXPECT_NEAR((map.find(name(0, 0))->position - seen - Eigen::Vector3d(-5, 0, 0)).norm(), 0, 1e-12);
  EXPECT_FALSE(map.find(made.id)) << "its name means another landmark now";
  const LandmarkId now = names.of(made.id);
  ASSERT_TRUE(map.find(now));
  EXPECT_EQ(map.find(now)->anchor, (KeyframeId{kEpoch, 0}));
  EXPECT_EQ(names.of(name(0, 0)), name(0, 0));
  EXPECT_FALSE(names.of({LandmarkId::kServer, 77}).is_valid());

  // The new map gets the third keyframe only, and all that it does not know stays.
  other.mapped_keyframes = 3;
  other.keyframes = {{{kEpoch, 2}, moved(0.3)}};
  map.apply(other);
  EXPECT_NEAR(map.pose_of({kEpoch, 1})->translation.x(), 0.1, 1e-12);
  EXPECT_NEAR(map.pose_of({kEpoch, 2})->translation.x(), 0.3, 1e-12);
  EXPECT_TRUE(map.find(name(0, 0)));
  map.apply(other);
  EXPECT_TRUE(map.find(name(0, 0)));
  EXPECT_FALSE(map.find(name(2, 0))) << "mapped in this map, and culled";
}

TEST(LocalMap, AKeyframeOfAFormerMapKnowsItsLandmarksByTheirNewNames) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 2), moved(0));
  MapUpdate first = update_of(1);
  first.map = {1};
  LandmarkState made;
  made.id = {LandmarkId::kServer, 5};
  made.observers = {{kEpoch, 0}};
  LandmarkState foreign;
  foreign.id = {LandmarkId::kServer, 6};
  foreign.observers = {{kEpoch + 1, 0}};
  first.landmarks = {made, foreign};
  first.removed_landmarks = {{name(0, 1), made.id}};  // fused
  map.apply(first);
  map.add_keyframe(make_keyframe(1, 0, {made.id, name(0, 0), foreign.id}), moved(0));
  const NewNames names = map.change_map(moved(1));
  // The new map's server uses the names for other landmarks.
  MapUpdate other = update_of(0);
  other.base_revision = 0;
  other.map = {2};
  other.landmarks = {made, foreign};
  map.apply(other);

  const LandmarkId now = names.of(made.id), seen_too = names.of(foreign.id);
  ASSERT_TRUE(map.find(now));
  const auto recent = map.recent_keyframes();
  EXPECT_EQ(map.landmarks_by_feature(*recent[0]),
            (std::vector<LandmarkId>{now, name(0, 0), seen_too}));
  EXPECT_EQ(map.landmarks_by_feature(*recent[1]), (std::vector<LandmarkId>{name(0, 0), now}));
}

TEST(LocalMap, AMergeMovesEverythingAndForgetsNothing) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  MapUpdate first = update_of(1);
  first.map = {1};
  map.apply(first);
  const Eigen::Vector3d seen = map.find(name(0, 0))->position;
  MapUpdate merge = update_of(1);
  merge.map = {2};
  merge.new_map_from_old_map = Sim3(moved(3));
  EXPECT_FALSE(map.is_of_another_map(merge));
  map.apply(merge);
  EXPECT_NEAR(map.pose_of({kEpoch, 0})->translation.x(), 3, 1e-12);
  EXPECT_NEAR((map.find(name(0, 0))->position - seen - Eigen::Vector3d(3, 0, 0)).norm(), 0, 1e-12);
}

TEST(LocalMap, AMergeOfAnotherScaleScalesEverything) {
  LocalMap map;
  map.add_keyframe(make_keyframe(0, 1), moved(0));
  map.add_keyframe(make_keyframe(1, 1, {}, moved(0.2)), moved(0.2));
  const LocalLandmark before = *map.find(name(1, 0));
  const Sim3 move({1, 0, 0, 0}, {3, 0, 0}, 2.5);
  MapUpdate merge = update_of(1);
  merge.new_map_from_old_map = move;
  map.apply(merge);
  EXPECT_NEAR(map.pose_of({kEpoch, 1})->translation.x(), 3.5, 1e-12);
  EXPECT_NEAR(map.scaled_pose_of({kEpoch, 1})->scale, 2.5, 1e-12);
  const LocalLandmark after = *map.find(name(1, 0));
  EXPECT_NEAR((after.position - move * before.position).norm(), 0, 1e-9);
  EXPECT_NEAR(after.max_distance / before.max_distance, 2.5, 1e-5);
  EXPECT_NEAR(after.min_distance / before.min_distance, 2.5, 1e-5);
  // The second keyframe, not placed yet, still hangs on the first one by what was measured.
  MapUpdate placed = update_of(1);
  placed.keyframes = {{{kEpoch, 0}, Sim3({1, 0, 0, 0}, {4, 0, 0}, 5)}};
  map.apply(placed);
  EXPECT_NEAR(map.pose_of({kEpoch, 1})->translation.x(), 5, 1e-12);
  EXPECT_NEAR(map.scaled_pose_of({kEpoch, 1})->scale, 5, 1e-12);
}

TEST(LocalMap, KnowsWhichKeyframesHangTogether) {
  LocalMap map;
  const auto add = [&](std::uint32_t sequence, KeyframeId reference) {
    auto keyframe = std::make_shared<Keyframe>(*make_keyframe(sequence, 1));
    keyframe->reference = reference;
    map.add_keyframe(keyframe, moved(0));
  };
  add(0, {});
  add(1, {kEpoch, 0});
  add(2, {});  // lost: a new part
  add(3, {kEpoch, 2});
  add(4, {kEpoch + 1, 8});  // found by the server where another client has been
  add(5, {kEpoch, 1});      // found again by itself
  using Parts = std::vector<std::uint32_t>;
  EXPECT_EQ(map.parts(), (Parts{0, 0, 1, 1, 2, 0})) << "by itself";
  MapUpdate u = update_of(5);
  u.parts = {{0, 0}, {2, 1}, {4, 0}};
  map.apply(u);
  EXPECT_EQ(map.parts(), (Parts{0, 0, 1, 1, 0, 0})) << "the other client's part is the first one";
  u.parts = {};
  map.apply(u);
  EXPECT_EQ(map.parts(), (Parts{0, 0, 1, 1, 0, 0})) << "no news";
  u.parts = {{0, 0}};
  u.mapped_keyframes = 6;
  map.apply(u);
  EXPECT_EQ(map.parts(), (Parts{0, 0, 0, 0, 0, 0}));
  add(6, {});
  EXPECT_EQ(map.parts(), (Parts{0, 0, 0, 0, 0, 0, 1})) << "until the server has told";
}

TEST(LocalMap, DropsTheLeastUsedLandmarksBeyondItsLimit) {
  LocalMap map({.landmarks = 21, .keyframes_with_features = 2});
  map.add_keyframe(make_keyframe(0, 15), moved(0));
  map.add_keyframe(make_keyframe(1, 4), moved(0));
  const std::vector<LandmarkId> seen{name(0, 0)};
  map.around(seen, 1);  // uses keyframe 0's
  map.add_keyframe(make_keyframe(2, 4), moved(0));
  EXPECT_LE(map.landmark_count(), 21u);
  EXPECT_TRUE(map.find(name(0, 0)));
  EXPECT_EQ(map.recent_keyframes().size(), 2u);
}

}  // namespace
}  // namespace cairn
