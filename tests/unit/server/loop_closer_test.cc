#include "server/loop_closer.h"

#include <future>

#include <gmock/gmock.h>

#include "server/map/connected.h"
#include "server/map/invariants.h"
#include "server/optimize/local_ba.h"
#include "server/place/default_vocabulary.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;
using testing::SizeIs;

constexpr std::uint64_t kFirst = 7, kSecond = 8;

std::shared_ptr<const Vocabulary> vocabulary() {
  static const auto loaded = std::make_shared<const Vocabulary>(*default_vocabulary());
  return loaded;
}

MapDelta solve(const Map& map, const LocalWindow& window, std::stop_token stop) {
  return solve_local_ba(map, window, {}, nullptr, stop);
}

struct Closing {
  explicit Closing(LoopCloserOptions options = {}, std::size_t mapping_waits = 0) {
    LoopCloserHooks hooks;
    hooks.solve = solve;
    hooks.mapping_waits = [mapping_waits] { return mapping_waits; };
    hooks.keep = [this](const Map& before) {
      kept.push_back(before.loops.size());
      return Status();
    };
    hooks.changed = [this] { ++changes; };
    closer = std::make_unique<LoopCloser>(writer, vocabulary(), options, std::move(hooks));
  }
  void add(const SyntheticMap& world) {
    for (const KeyframePtr& keyframe : world.keyframes) {
      writer.submit(keyframe);
      closer->offer(keyframe->id);
    }
  }

  MapWriter writer{Map{}};
  std::vector<std::size_t> kept;
  std::atomic<int> changes = 0;
  std::unique_ptr<LoopCloser> closer;
};

TEST(LoopCloser, MergesThePartsOfClientsThatSeeTheSamePlace) {
  const SyntheticMap first({.keyframes = 8, .epoch = kFirst});
  const SyntheticMap second({.keyframes = 8, .epoch = kSecond, .start = 0.3});
  Closing run;
  run.add(first);
  run.add(second);
  run.closer->close();
  const Snapshot map = run.writer.snapshot();
  EXPECT_EQ(run.closer->counters().merges, 1u);
  EXPECT_THAT(connected_keyframes(*map, {kFirst, 0}), SizeIs(16));
  ASSERT_THAT(map->loops, SizeIs(1));
  EXPECT_TRUE(map->loops[0].merges);
  EXPECT_THAT(map->loops[0].moved, testing::ElementsAre(kSecond));
  EXPECT_THAT(check_invariants(*map), IsEmpty());
  EXPECT_THAT(run.kept, testing::ElementsAre(0u));
  EXPECT_GT(run.changes, 0);
  // The second client started 0.3 m along x from where the first one did.
  const Rigid3 first_from_second = map->keyframes.at({kFirst, 0}).map_from_camera.inverse() *
                                   map->keyframes.at({kSecond, 0}).map_from_camera;
  EXPECT_LT((first_from_second.translation - Eigen::Vector3d(0.3, 0, 0)).norm(), 0.02);
}

TEST(LoopCloser, AClientThatHasLeftAPartDoesNotMoveWithIt) {
  const SyntheticMap first({.keyframes = 8, .epoch = kFirst});
  // The second client's newest keyframe will be elsewhere: in the part that stays.
  const SyntheticMap second({.keyframes = 9, .epoch = kSecond, .start = 0.3});
  Closing run;
  run.add(first);
  auto elsewhere = std::make_shared<Keyframe>(*first.keyframes.back());
  elsewhere->id = {kSecond, 20};
  elsewhere->reference = first.keyframes.back()->id;
  run.writer.submit(KeyframePtr(elsewhere));
  run.add(second);
  run.closer->close();
  const Snapshot map = run.writer.snapshot();
  ASSERT_EQ(run.closer->counters().merges, 1u);
  EXPECT_THAT(map->loops[0].moved, IsEmpty());
}

TEST(LoopCloser, LeavesClientsApartThatSeeDifferentPlaces) {
  const SyntheticMap first({.keyframes = 8, .seed = 1, .epoch = kFirst});
  const SyntheticMap second({.keyframes = 8, .seed = 2, .epoch = kSecond});
  Closing run;
  run.add(first);
  run.add(second);
  run.closer->close();
  EXPECT_EQ(run.closer->counters().merges, 0u);
  EXPECT_THAT(run.writer.snapshot()->loops, IsEmpty());
  EXPECT_EQ(run.closer->counters().recognised, 16u);
}

// A run that goes on where it began, but believes to be a metre off: as after a long way.
void come_back_drifted(Closing& run) {
  const SyntheticMap world({.keyframes = 10, .epoch = kFirst});
  const Rigid3 drift(so3_exp({0, 0.1, 0}), {1, 0, 0});
  run.add(world);
  SyntheticMap again({.keyframes = 5, .epoch = kFirst});
  for (std::size_t i = 0; i < again.keyframes.size(); ++i) {
    auto keyframe = std::make_shared<Keyframe>(*again.keyframes[i]);
    keyframe->id.sequence += 10;
    keyframe->reference = {kFirst, keyframe->id.sequence - 1};
    if (i == 0) {
      // By odometry: from the last keyframe to the first one's place, and off by the drift.
      keyframe->reference_from_camera = world.map_from_camera[9].inverse() * drift;
      keyframe->matches.clear();
    }
    for (LandmarkMatch& match : keyframe->matches)
      if (match.landmark.origin != LandmarkId::kServer) {
        KeyframeId creator = match.landmark.creator();
        creator.sequence += 10;
        match.landmark = LandmarkId::from_feature(creator, match.landmark.creator_feature());
      }
    run.writer.submit(keyframe);
    run.closer->offer(keyframe->id);
    run.closer->wait_idle();  // so that none waits while another is looked up
  }
  run.closer->close();
}

TEST(LoopCloser, ClosesALoopThatHasDrifted) {
  Closing run;
  come_back_drifted(run);
  const Snapshot map = run.writer.snapshot();
  EXPECT_EQ(run.closer->counters().loops, 1u);
  EXPECT_EQ(map->merge_epoch, 1u);
  EXPECT_THAT(check_invariants(*map), IsEmpty());
  EXPECT_LT((map->keyframes.at({kFirst, 12}).map_from_camera.translation -
             map->keyframes.at({kFirst, 2}).map_from_camera.translation)
                .norm(),
            0.1);
}

TEST(LoopCloser, WhileMappingIsBehindItOnlyMerges) {
  constexpr std::size_t kBehind = 3;
  Closing loops({}, kBehind);
  come_back_drifted(loops);
  EXPECT_EQ(loops.closer->counters().loops, 0u);

  Closing merges({}, kBehind);
  merges.add(SyntheticMap({.keyframes = 8, .epoch = kFirst}));
  merges.add(SyntheticMap({.keyframes = 8, .epoch = kSecond, .start = 0.3}));
  merges.closer->close();
  EXPECT_EQ(merges.closer->counters().merges, 1u);
}

TEST(LoopCloser, BelievesOnlyWhatItsOptionsAskFor) {
  const SyntheticMap first({.keyframes = 8, .epoch = kFirst});
  const SyntheticMap second({.keyframes = 8, .epoch = kSecond, .start = 0.3});
  LoopCloserOptions options;
  options.verify.min_inliers = 1000;
  Closing run(options);
  run.add(first);
  run.add(second);
  run.closer->close();
  EXPECT_EQ(run.closer->counters().merges, 0u);
}

// Finishing is for the run as it was: what comes later has to be dealt with first.
TEST(LoopCloser, AKeyframeThatComesLaterUnsettlesItsRun) {
  const SyntheticMap world({.keyframes = 4, .epoch = kFirst});
  Closing run;
  run.closer->finish(kFirst);
  run.closer->wait_idle();
  EXPECT_TRUE(run.closer->settled(kFirst));
  run.add(world);
  run.closer->wait_idle();
  EXPECT_TRUE(run.closer->settled(kFirst));
  EXPECT_EQ(run.closer->counters().recognised, 4u);
}

TEST(LoopCloser, SettlesARunOnceItsMapIsAdjusted) {
  const SyntheticMap first({.keyframes = 6, .epoch = kFirst});
  const SyntheticMap second({.keyframes = 6, .epoch = kSecond, .start = 0.2});
  Closing run;
  run.add(first);
  run.add(second);
  EXPECT_FALSE(run.closer->settled(kSecond));
  run.closer->finish(kSecond);
  run.closer->wait_idle();
  EXPECT_TRUE(run.closer->settled(kSecond));
  EXPECT_FALSE(run.closer->settled(kFirst));
  EXPECT_GE(run.closer->adjuster().adjustments(), 1u);
  run.closer->forget(kSecond);
  run.closer->wait_idle();
  EXPECT_FALSE(run.closer->settled(kSecond));
}

TEST(LoopCloser, ARunWithoutKeyframesIsSettledAtOnce) {
  Closing run;
  run.closer->finish(99);
  run.closer->wait_idle();
  EXPECT_TRUE(run.closer->settled(99));
}

}  // namespace
}  // namespace cairn
