#include "client/tracking/tracker.h"

#include <gtest/gtest.h>

#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;
using testing::wander;

constexpr std::int64_t kFrameNs = 33'333'333;

struct Walk {
  std::shared_ptr<const Rig> rig = testing::test_rig();
  FeatureWorld world{11};
  Tracker tracker{99, rig};
  std::int64_t stamp = 0;

  TrackingResult step(const Rigid3& pose, double noise = 0.3) {
    return tracker.track(stamp += kFrameNs, world.view(*rig, pose, noise, 10));
  }
  TrackingResult blind() { return tracker.track(stamp += kFrameNs, Features{}); }
};

TEST(Tracker, WaitsForAFrameWithDepthToStart) {
  Walk run;
  EXPECT_EQ(run.blind().state, TrackingState::kStarting);
  const TrackingResult first = run.step(wander(0));
  EXPECT_EQ(first.state, TrackingState::kTracking);
  ASSERT_TRUE(first.keyframe);
  EXPECT_EQ(first.keyframe->id, (KeyframeId{99, 0}));
  EXPECT_FALSE(first.keyframe->reference.is_valid());
}

TEST(Tracker, FollowsAWanderingCamera) {
  Walk run;
  run.tracker.set_has_server(false);
  const Rigid3 origin = wander(0);
  for (int i = 0; i < 300; ++i) {
    const Rigid3 truth = origin.inverse() * wander(i / 30.0);
    const TrackingResult r = run.step(wander(i / 30.0));
    ASSERT_EQ(r.state, TrackingState::kTracking) << "frame " << i;
    // It drifts past 5 cm after 231 frames, with 0.3 px of noise and no server to correct it.
    ASSERT_LT((r.map_from_camera.translation - truth.translation).norm(), 0.08) << "frame " << i;
  }
  EXPECT_GT(run.tracker.keyframes_made(), 5u);
  EXPECT_LT(run.tracker.keyframes_made(), 150u);
  EXPECT_EQ(run.tracker.trajectory().size(), 300u);
}

// Sharp views let the outlier bound shrink; a blow to the camera comes without a warning.
TEST(Tracker, KeepsItsLandmarksInASuddenlyBlurredView) {
  Walk run;
  run.tracker.set_has_server(false);
  int landmarks = 0;
  for (int i = 0; i < 60; ++i) landmarks = run.step(wander(i / 30.0), 0.15).landmarks;
  const TrackingResult blurred = run.step(wander(2), 1.5);
  ASSERT_EQ(blurred.state, TrackingState::kTracking);
  EXPECT_GT(blurred.landmarks, 0.6 * landmarks);
}

// Neither sharp nor blurred: more than half of it would fit the bound of the sharp ones.
TEST(Tracker, KeepsItsLandmarksInAViewThatIsSomewhatWorse) {
  Walk run;
  run.tracker.set_has_server(false);
  int landmarks = 0;
  for (int i = 0; i < 60; ++i) landmarks = run.step(wander(i / 30.0), 0.15).landmarks;
  EXPECT_GT(run.step(wander(2), 1.0).landmarks, 0.8 * landmarks);
}

// Who comes back, to what others have mapped perhaps, is not held against its former precision.
TEST(Tracker, FindsItselfAgainInWorseViewsThanItHadBefore) {
  Walk run;
  run.tracker.set_has_server(false);
  int landmarks = 0;
  for (int i = 0; i < 60; ++i) landmarks = run.step(wander(i / 30.0), 0.15).landmarks;
  run.blind();
  TrackingResult back;
  for (int i = 0; i < 5 && back.state != TrackingState::kTracking; ++i)
    back = run.step(wander(1.9), 0.8);
  ASSERT_EQ(back.state, TrackingState::kTracking);
  EXPECT_GT(back.landmarks, 0.7 * landmarks);
}

TEST(Tracker, KeepsOnePoseAKeyframeWhereNobodyAsksForMore) {
  TrackerOptions options;
  options.keep_every_pose = false;
  Walk run{.tracker{99, testing::test_rig(), options}};
  run.tracker.set_has_server(false);
  for (int i = 0; i < 150; ++i) run.step(wander(i / 30.0));
  EXPECT_GT(run.tracker.trajectory().size(), 1u);
  EXPECT_LE(run.tracker.trajectory().size(), run.tracker.keyframes_made());
  EXPECT_EQ(run.tracker.trajectory_by_part().size(), 1u);
}

TEST(Tracker, IsLostWithoutFeaturesAndFindsItselfAgain) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 60; ++i) run.step(wander(i / 30.0));
  for (int i = 0; i < 10; ++i) EXPECT_EQ(run.blind().state, TrackingState::kLost);
  // Comes back somewhat elsewhere, where it has been before.
  bool found = false;
  Rigid3 pose = wander(0.5);
  for (int i = 0; i < 5 && !found; ++i) {
    const TrackingResult r = run.step(pose);
    found = r.state == TrackingState::kTracking;
    if (found) {
      const Rigid3 truth = wander(0).inverse() * pose;
      EXPECT_LT((r.map_from_camera.translation - truth.translation).norm(), 0.03);
    }
  }
  EXPECT_TRUE(found);
  EXPECT_EQ(run.tracker.trajectory().size(), 61u) << "lost frames have no pose";
}

TEST(Tracker, MatchesReportedWithAKeyframeAreAscendingAndOfTrueLandmarks) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 120; ++i) {
    const TrackingResult r = run.step(wander(i / 30.0));
    if (!r.keyframe) continue;
    for (std::size_t m = 1; m < r.keyframe->matches.size(); ++m)
      ASSERT_LT(r.keyframe->matches[m - 1].feature, r.keyframe->matches[m].feature);
    for (const LandmarkMatch& m : r.keyframe->matches) ASSERT_TRUE(m.landmark.is_valid());
  }
}

TEST(Tracker, CorrectionsMoveTheMapPoseButNotTheOdometry) {
  Walk run;
  TrackingResult r;
  for (int i = 0; i < 20; ++i) r = run.step(wander(i / 30.0));
  const Rigid3 odom_before = r.odom_from_camera;
  const Rigid3 map_before = r.map_from_camera;
  MapUpdate update;
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = 1;
  const Rigid3 shift(so3_exp({0, 0.1, 0}), {1, 2, 3});
  for (std::uint32_t s = 0; s < run.tracker.keyframes_made(); ++s)
    update.keyframes.push_back({{99, s}, shift * *run.tracker.map().pose_of({99, s})});
  run.tracker.apply(update);
  // The same view again: the pose has moved with the map, odometry has not.
  r = run.step(wander(19 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT(((shift * map_before).translation - r.map_from_camera.translation).norm(), 0.01);
  EXPECT_LT((odom_before.translation - r.odom_from_camera.translation).norm(), 0.01);
  // The written trajectory is the corrected one.
  EXPECT_LT(
      (run.tracker.trajectory().front().world_from_camera.translation - shift.translation).norm(),
      1e-9);
}

// A server that comes back without its map tells of an empty one, in whose frame odom is taken to
// be.
TEST(Tracker, GoesOnInItsOwnFrameWhenTheServerHasAnotherMap) {
  Walk run;
  TrackingResult r;
  for (int i = 0; i < 20; ++i) r = run.step(wander(i / 30.0));
  MapUpdate update;
  update.map = {1};
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = run.tracker.keyframes_made();
  const Rigid3 shift(so3_exp({0, 0.1, 0}), {1, 2, 3});
  for (std::uint32_t s = 0; s < run.tracker.keyframes_made(); ++s)
    update.keyframes.push_back({{99, s}, shift * *run.tracker.map().pose_of({99, s})});
  run.tracker.apply(update);
  r = run.step(wander(20 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  ASSERT_GT((r.map_from_camera.translation - r.odom_from_camera.translation).norm(), 1.0);

  MapUpdate other;
  other.map = {2};
  other.revision = 1;
  other.epoch = 99;
  run.tracker.apply(other);
  const Rigid3 odom_before = r.odom_from_camera;
  r = run.step(wander(20 / 30.0));
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_LT((r.map_from_camera.translation - r.odom_from_camera.translation).norm(), 1e-9);
  EXPECT_LT((r.odom_from_camera.translation - odom_before.translation).norm(), 0.01);
  EXPECT_LT(run.tracker.trajectory().front().world_from_camera.translation.norm(), 1e-9);
}

// Fusion and culling leave little of what the client has named: most is of the server's making.
TEST(Tracker, IsNotLostWhenAllItSeesHadTheFormerServersNames) {
  Walk run;
  TrackingResult r;
  std::vector<LandmarkId> named;
  for (int i = 0; i < 20; ++i) {
    r = run.step(wander(i / 30.0));
    if (!r.keyframe) continue;
    for (const LandmarkMatch& m : r.keyframe->matches)
      if (m.landmark.creator() == r.keyframe->id) named.push_back(m.landmark);
  }
  MapUpdate update;
  update.map = {1};
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = run.tracker.keyframes_made();
  std::uint64_t number = 1;
  for (const LandmarkId id : named) {
    const LocalLandmark* l = run.tracker.map().find(id);
    LandmarkState made{.id = {LandmarkId::kServer, number++},
                       .position = l->position,
                       .normal = l->normal,
                       .min_distance = l->min_distance,
                       .max_distance = l->max_distance,
                       .descriptor = l->descriptor,
                       .observers = l->observers};
    update.landmarks.push_back(made);
    update.removed_landmarks.push_back({id, made.id});
  }
  run.tracker.apply(update);
  const int before = run.step(wander(20 / 30.0)).landmarks;
  MapUpdate other;
  other.map = {2};
  other.revision = 1;
  other.epoch = 99;
  run.tracker.apply(other);
  r = run.step(wander(21 / 30.0));
  EXPECT_EQ(r.state, TrackingState::kTracking);
  EXPECT_GT(r.landmarks, 0.9 * before);
}

// Keyframes of 4 s of the walk that nobody maps, where no view is so weak that it gets one anyway.
std::uint32_t keyframes_made(bool has_server) {
  TrackerOptions options;
  options.keyframes.min_shared = 0.9;
  options.keyframes.weak_shared = 0;
  options.keyframes.min_near_new = 1'000'000;
  const auto rig = testing::test_rig();
  FeatureWorld world{11};
  Tracker tracker(99, rig, options);
  tracker.set_has_server(has_server);
  for (int i = 0; i < 120; ++i)
    tracker.track(i * kFrameNs, world.view(*rig, wander(i / 30.0), 0.3, 10));
  EXPECT_EQ(tracker.unmapped(), static_cast<int>(tracker.keyframes_made()));
  return tracker.keyframes_made();
}

TEST(Tracker, WaitsForTheMapperOnlyWhileThereIsAServer) {
  EXPECT_EQ(keyframes_made(true), 3u) << "as many as may await mapping";
  EXPECT_GT(keyframes_made(false), 6u);
}

// What a restarted server says of its progress is less than its predecessor said, or too much of a
// lost map: neither makes anybody wait for keyframes that nobody will map.
TEST(Tracker, KeyframesCountAsMappedOnce) {
  Walk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 120; ++i) run.step(wander(i / 30.0));
  const auto made = run.tracker.keyframes_made();
  ASSERT_GE(made, 3u);
  MapUpdate update;
  update.base_revision = 1;
  update.revision = 2;
  update.epoch = 99;
  update.mapped_keyframes = 2;
  run.tracker.apply(update);
  EXPECT_EQ(run.tracker.unmapped(), static_cast<int>(made) - 2);
  update.mapped_keyframes = 1;
  run.tracker.apply(update);
  EXPECT_EQ(run.tracker.keyframes_mapped(), 2u);
  run.tracker.write_off(made);
  run.tracker.write_off(1);
  EXPECT_EQ(run.tracker.unmapped(), 0);
}

// A server that knows the whole world, in a frame in which this client has never been.
struct Server {
  const KeyframeId reference{7, 3};
  const Rigid3 map_from_world{so3_exp({0, 0.4, 0}), {10, 0, -3}};

  // What it says of a view of the world at that pose: features match in the order of the view.
  RelocaliseAnswer answer(Walk& run, const Keyframe& question, const Rigid3& pose) const {
    RelocaliseAnswer a;
    a.epoch = question.id.epoch;
    a.number = question.id.sequence;
    a.found = true;
    a.reference = reference;
    a.map_from_reference = map_from_world;
    a.map_from_camera = map_from_world * pose;
    a.around.map = run.tracker.map().id();
    a.around.base_revision = 1;
    a.around.revision = 2;
    a.around.epoch = a.epoch;
    for (std::size_t f = 0; f < question.features.size(); ++f) {
      LandmarkState l;
      l.id = {7, f + 1};
      l.position = map_from_world * run.world.point_of(f);
      l.normal = (a.map_from_camera.translation - l.position).normalized();
      l.min_distance = 0.1f;
      l.max_distance =
          static_cast<float>((a.map_from_camera.translation - l.position).norm() *
                             run.rig->pyramid.scale(question.features.points[f].octave));
      l.descriptor = question.features.descriptors[f];
      l.observers = {reference};
      a.around.landmarks.push_back(l);
      if (f % 2 == 0) a.matches.push_back({static_cast<std::uint16_t>(f), l.id});
    }
    return a;
  }
};

// Begins at wander(0), is told of the server's map, and goes blind after 20 frames.
struct LostWalk : Walk {
  LostWalk() {
    for (int i = 0; i < 20; ++i) step(wander(i / 30.0));
    MapUpdate update;
    update.map = {1};
    update.base_revision = 1;
    update.revision = 2;
    update.epoch = 99;
    update.mapped_keyframes = tracker.keyframes_made();
    tracker.apply(update);
    for (int i = 0; i < 60; ++i) {
      const TrackingResult r = blind();
      EXPECT_EQ(r.state, TrackingState::kLost);
      EXPECT_FALSE(r.question) << "there is nothing to be seen";
    }
  }
  // A place of another world, where this client has never been.
  Keyframe asked() {
    for (int i = 0; i < 3; ++i)
      if (const TrackingResult r = step_elsewhere(); r.question) return *r.question;
    ADD_FAILURE() << "does not ask";
    return {};
  }
  TrackingResult step_elsewhere() {
    std::swap(world, elsewhere);
    const TrackingResult r = step(kThere);
    std::swap(world, elsewhere);
    return r;
  }
  RelocaliseAnswer answer(const Keyframe& question) {
    std::swap(world, elsewhere);
    const RelocaliseAnswer a = server.answer(*this, question, kThere);
    std::swap(world, elsewhere);
    return a;
  }

  static RelocaliseAnswer nowhere(const Keyframe& question) {
    RelocaliseAnswer a;
    a.epoch = question.id.epoch;
    a.number = question.id.sequence;
    return a;
  }

  const Rigid3 kThere = wander(3);
  FeatureWorld elsewhere{23};
  Server server;
};

TEST(Tracker, AsksTheServerWhileItIsLostAndSees) {
  LostWalk run;
  const Keyframe question = run.asked();
  EXPECT_EQ(question.id, (KeyframeId{99, 1}));
  EXPECT_FALSE(question.reference.is_valid());
  EXPECT_TRUE(question.matches.empty());
  EXPECT_GT(question.features.size(), 100u);
  // One at a time: the next one when this one is answered, or overdue.
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(run.step_elsewhere().question);
  EXPECT_EQ(run.tracker.take(run.nowhere(question)).state, TrackingState::kLost);
  const TrackingResult next = run.step_elsewhere();
  ASSERT_TRUE(next.question);
  EXPECT_EQ(next.question->id.sequence, 2u);
}

TEST(Tracker, AsksNobodyWhereThereIsNoServer) {
  LostWalk run;
  run.tracker.set_has_server(false);
  for (int i = 0; i < 120; ++i) {
    const TrackingResult r = run.step_elsewhere();
    EXPECT_EQ(r.state, TrackingState::kLost);
    EXPECT_FALSE(r.question);
  }
}

TEST(Tracker, AsksAsSoonAsItIsInTouchAgain) {
  LostWalk run;
  run.tracker.set_in_touch(false);
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(run.step_elsewhere().question);
  run.tracker.set_in_touch(true);
  EXPECT_TRUE(run.step_elsewhere().question);
}

TEST(Tracker, GoesOnWhereTheServerHasFoundIt) {
  LostWalk run;
  const Keyframe question = run.asked();
  const std::size_t before = run.tracker.trajectory().size();
  run.step_elsewhere();
  const TrackingResult found = run.tracker.take(run.answer(question));
  ASSERT_EQ(found.state, TrackingState::kTracking);
  EXPECT_GT(found.landmarks, 100);
  // The keyframe tells the server in which part of the map this client is now.
  ASSERT_TRUE(found.keyframe);
  EXPECT_EQ(found.keyframe->reference, run.server.reference);
  EXPECT_EQ(found.keyframe->stamp_ns, question.stamp_ns);
  EXPECT_LT((found.keyframe->reference_from_camera.translation - run.kThere.translation).norm(),
            0.01);
  const auto of_others =
      std::count_if(found.keyframe->matches.begin(), found.keyframe->matches.end(),
                    [](const LandmarkMatch& m) { return m.landmark.origin == 7; });
  EXPECT_GT(of_others, 100);

  const TrackingResult next = run.step_elsewhere();
  ASSERT_EQ(next.state, TrackingState::kTracking);
  const Rigid3 truth = run.server.map_from_world * run.kThere;
  EXPECT_LT((next.map_from_camera.translation - truth.translation).norm(), 0.01);
  EXPECT_EQ(run.tracker.trajectory().size(), before + 2) << "the frame asked about, and this one";
}

TEST(Tracker, OdometryDoesNotJumpToAPlaceThatItDoesNotKnowTheWayTo) {
  LostWalk run;
  const Rigid3 last = wander(0).inverse() * wander(19 / 30.0);
  const TrackingResult found = run.tracker.take(run.answer(run.asked()));
  ASSERT_EQ(found.state, TrackingState::kTracking);
  EXPECT_LT((found.odom_from_camera.translation - last.translation).norm(), 0.02);
}

// Late, of another state of the map, or contradicted by the frame itself.
TEST(Tracker, AnswersThatDoNotHoldChangeNothing) {
  for (int kind = 0; kind < 4; ++kind) {
    LostWalk run;
    const Keyframe question = run.asked();
    RelocaliseAnswer answer = run.answer(question);
    if (kind == 0) answer.number = 77;
    if (kind == 1) answer.around.merge_epoch = 5;
    if (kind == 2) answer.around.map = {2};
    if (kind == 3)
      for (LandmarkState& l : answer.around.landmarks) l.position = -l.position;
    const std::uint32_t made = run.tracker.keyframes_made();
    EXPECT_EQ(run.tracker.take(answer).state, TrackingState::kLost) << kind;
    EXPECT_EQ(run.tracker.keyframes_made(), made) << kind;
    EXPECT_EQ(run.step_elsewhere().state, TrackingState::kLost) << kind;
  }
}

TEST(Tracker, WhatItHasFoundItselfNeedsNoAnswer) {
  LostWalk run;
  const RelocaliseAnswer answer = run.answer(run.asked());
  ASSERT_EQ(run.step(wander(0.5)).state, TrackingState::kTracking);
  EXPECT_FALSE(run.tracker.awaits_answer());
  const TrackingResult r = run.tracker.take(answer);
  EXPECT_EQ(r.state, TrackingState::kTracking);
  EXPECT_FALSE(r.keyframe);
}

TEST(Tracker, StartsANewPartOfTheMapWhereNobodyFindsIt) {
  LostWalk run;
  const std::size_t before = run.tracker.trajectory().size();
  TrackingResult r;
  int lost = 0;
  while (lost < 120 && (r = run.step_elsewhere()).state == TrackingState::kLost) {
    ++lost;
    if (r.question) run.tracker.take(run.nowhere(*r.question));
  }
  ASSERT_EQ(r.state, TrackingState::kTracking);
  EXPECT_GE(lost, 30) << "a second at least";
  EXPECT_LE(lost, 60) << "and two at most";
  ASSERT_TRUE(r.keyframe);
  EXPECT_FALSE(r.keyframe->reference.is_valid()) << "nothing connects it with what was before";
  EXPECT_EQ(r.keyframe->noise, 1) << "nothing has been measured here";
  for (const LandmarkMatch& m : r.keyframe->matches)
    EXPECT_EQ(m.landmark.creator(), r.keyframe->id);
  // Odometry is all that the server has to place it by: it goes on as if the camera had not moved.
  const Rigid3 last = wander(0).inverse() * wander(19 / 30.0);
  EXPECT_LT((r.keyframe->odom_from_camera.translation - last.translation).norm(), 0.02);
  EXPECT_EQ(run.step_elsewhere().state, TrackingState::kTracking);
  EXPECT_EQ(run.tracker.trajectory().size(), before + 2);
  ASSERT_EQ(run.tracker.trajectory_by_part().size(), 2u);
  EXPECT_EQ(run.tracker.trajectory_by_part()[0].size(), before);
  EXPECT_EQ(run.tracker.trajectory_by_part()[1].size(), 2u);
  // Corrections reach both parts.
  MapUpdate update;
  update.map = {1};
  update.base_revision = 2;
  update.revision = 3;
  update.epoch = 99;
  const Rigid3 shift({1, 0, 0, 0}, {1, 2, 3});
  const Rigid3 old = run.tracker.trajectory().front().world_from_camera;
  update.keyframes.push_back({{99, 0}, shift * *run.tracker.map().pose_of({99, 0})});
  run.tracker.apply(update);
  EXPECT_LT(
      ((shift * old).translation - run.tracker.trajectory().front().world_from_camera.translation)
          .norm(),
      1e-9);
}

// One that recognises no places could not join the parts.
TEST(Tracker, StartsNothingNewForAServerThatDoesNotAnswer) {
  LostWalk run;
  for (int i = 0; i < 150; ++i) EXPECT_EQ(run.step_elsewhere().state, TrackingState::kLost);
}

// A single camera can't start at its first frame; in a map that somebody has made it can.
TEST(Tracker, BeginsInTheServersMapWhereItCannotStartAlone) {
  Rig rig = *testing::test_rig();
  rig.sensor = Sensor::kMono;
  rig.camera.baseline = 0;
  Walk run{std::make_shared<const Rig>(rig)};
  MapUpdate update;
  update.map = {1};
  update.revision = 1;
  update.epoch = 99;
  run.tracker.apply(update);
  const auto look = [&](const Rigid3& pose) {
    Features features = run.world.view(*run.rig, pose, 0.3, 10);
    for (Feature& f : features.points) f.disparity = 0;
    return run.tracker.track(run.stamp += kFrameNs, std::move(features));
  };
  const TrackingResult first = look(wander(1));
  ASSERT_EQ(first.state, TrackingState::kStarting);
  ASSERT_TRUE(first.question);
  const Server server;
  const TrackingResult found = run.tracker.take(server.answer(run, *first.question, wander(1)));
  ASSERT_EQ(found.state, TrackingState::kTracking);
  ASSERT_TRUE(found.keyframe);
  EXPECT_EQ(found.keyframe->id, (KeyframeId{99, 0}));
  EXPECT_EQ(found.keyframe->reference, server.reference);
  const TrackingResult next = look(wander(1.03));
  ASSERT_EQ(next.state, TrackingState::kTracking);
  const Rigid3 truth = server.map_from_world * wander(1.03);
  EXPECT_LT((next.map_from_camera.translation - truth.translation).norm(), 0.02);
}

TEST(Tracker, TimeInTheDarkDoesNotMakeItStartAnew) {
  LostWalk run;
  for (int i = 0; i < 300; ++i) EXPECT_EQ(run.blind().state, TrackingState::kLost);
  EXPECT_EQ(run.step(wander(0.5)).state, TrackingState::kTracking);
}

}  // namespace
}  // namespace cairn
