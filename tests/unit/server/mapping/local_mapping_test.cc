#include "server/mapping/local_mapping.h"

#include <gmock/gmock.h>

#include "server/map/invariants.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

std::vector<LocalMappingReport> run(const SyntheticMap& world, MapWriter& writer,
                                    std::size_t waiting = 0,
                                    const LocalMappingOptions& options = {}) {
  LocalMapping mapping(writer, options);
  std::vector<LocalMappingReport> reports;
  for (const KeyframePtr& keyframe : world.keyframes) {
    writer.submit(keyframe);
    reports.push_back(mapping.extend(keyframe->id, waiting));
  }
  return reports;
}

TEST(LocalMapping, BuildsAValidMapWithFewDuplicates) {
  const SyntheticMap world(
      {.keyframes = 14, .depth_share = 0.6, .report_share = 0.5, .duplicate_share = 0.5});
  MapWriter writer(Map{});
  const auto reports = run(world, writer);
  const Snapshot map = writer.snapshot();
  EXPECT_THAT(check_invariants(*map), IsEmpty());
  int made = 0, fused = 0, added = 0;
  for (const LocalMappingReport& r : reports) {
    EXPECT_TRUE(r.found);
    made += r.landmarks_made, fused += r.fused, added += r.observations_added;
  }
  EXPECT_GT(made, 30);
  EXPECT_GT(fused, 20);
  EXPECT_GT(added, 200);
  double error = 0;
  map->landmarks.for_each([&](LandmarkId, const Landmark& l) {
    const Observation& o = l.observations.front();
    const auto point = static_cast<std::size_t>(world.point_of[o.keyframe.sequence][o.feature]);
    error += (l.position - world.points[point]).norm() / static_cast<double>(map->landmarks.size());
  });
  EXPECT_LT(error, 0.1);
}

TEST(LocalMapping, TheSameInputMakesTheSameMap) {
  const SyntheticMap world({.keyframes = 10, .report_share = 0.6, .duplicate_share = 0.4});
  MapWriter first(Map{}), second(Map{});
  run(world, first);
  run(world, second);
  const Snapshot a = first.snapshot(), b = second.snapshot();
  EXPECT_EQ(a->revision, b->revision);
  EXPECT_EQ(a->keyframes.sorted_keys(), b->keyframes.sorted_keys());
  ASSERT_EQ(a->landmarks.sorted_keys(), b->landmarks.sorted_keys());
  a->landmarks.for_each([&](LandmarkId id, const Landmark& l) {
    EXPECT_EQ(l.position, b->landmarks.at(id).position);
    EXPECT_EQ(l.observations, b->landmarks.at(id).observations);
  });
}

TEST(LocalMapping, AsksHalfAsManyNeighboursWhileManyKeyframesWait) {
  const SyntheticMap world({.keyframes = 14, .report_share = 0.5, .duplicate_share = 0.5});
  LocalMappingOptions all, half;
  all.fuse.first = 2, all.fuse.limit = 4;  // of all that overlap
  half.fuse.first = 1, half.fuse.limit = 2;
  const auto found = [&](const LocalMappingOptions& options, std::size_t waiting) {
    MapWriter writer(Map{});
    int observations = 0;
    for (const LocalMappingReport& r : run(world, writer, waiting, options))
      observations += r.observations_added + r.fused;
    return observations;
  };
  EXPECT_EQ(found(all, all.hurry_from + 1), found(half, 0));
  EXPECT_EQ(found(all, all.hurry_from), found(all, 0));
  EXPECT_NE(found(all, 0), found(half, 0)) << "the world is too small to tell";
}

TEST(LocalMapping, AnUnknownKeyframeIsReported) {
  MapWriter writer(Map{});
  EXPECT_FALSE(LocalMapping(writer).extend({7, 0}).found);
}

}  // namespace
}  // namespace cairn
