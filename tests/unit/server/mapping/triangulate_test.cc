#include "server/mapping/triangulate.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "common/feature/two_view.h"
#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "server/mapping/keyframe_view.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

using testing::IsEmpty;

// Keyframes of a depth camera that reports nothing: all is left to the server.
SyntheticOptions silent(SyntheticOptions options) {
  options.report_share = 0;
  options.depth_share = 0;
  return options;
}

int point_of(const SyntheticMap& world, const Observation& o) {
  return world.point_of[o.keyframe.sequence][o.feature];
}

struct Quality {
  int right = 0, wrong = 0;
  double median_error = 0;  // metres, of the right ones
};

Quality quality(const SyntheticMap& world, const MapDelta& delta) {
  Quality q;
  std::vector<double> errors;
  for (const auto& made : delta.new_landmarks) {
    const int point = point_of(world, made.observations[0]);
    const bool right =
        std::all_of(made.observations.begin(), made.observations.end(),
                    [&](const Observation& o) { return point_of(world, o) == point; });
    ++(right ? q.right : q.wrong);
    if (right)
      errors.push_back((made.position - world.points[static_cast<std::size_t>(point)]).norm());
  }
  if (errors.empty()) return q;
  std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
  q.median_error = errors[errors.size() / 2];
  return q;
}

TEST(Triangulate, FindsExactPointsWithoutDepth) {
  const SyntheticMap world(
      {.keyframes = 2, .sensor = Sensor::kMono, .step = 0.3, .pixel_noise = 0.0});
  const Quality q = quality(world, triangulate(built(world), {7, 1}));
  EXPECT_GT(q.right, 60);
  EXPECT_LE(q.wrong, 1);
  EXPECT_LT(q.median_error, 1e-4);  // features are stored as float
}

TEST(Triangulate, FindsNoisyPointsWithoutDepth) {
  const SyntheticMap world(
      {.keyframes = 2, .sensor = Sensor::kMono, .step = 0.3, .pixel_noise = 0.5});
  const Quality q = quality(world, triangulate(built(world), {7, 1}));
  EXPECT_GT(q.right, 50);
  EXPECT_LE(q.wrong, 2);
  EXPECT_LT(q.median_error, 0.12);
}

TEST(Triangulate, TakesNothingFromTooLittleParallax) {
  const SyntheticMap world({.keyframes = 2, .sensor = Sensor::kMono, .step = 0.002});
  EXPECT_THAT(triangulate(built(world), {7, 1}).new_landmarks, IsEmpty());
}

TEST(Triangulate, MeasuredDepthStandsInForParallax) {
  SyntheticMap world({.keyframes = 2, .step = 0.01});
  Map map;
  for (const KeyframePtr& keyframe : world.keyframes) {
    auto silenced = std::make_shared<Keyframe>(*keyframe);
    silenced->matches.clear();
    apply_keyframe(map, silenced);
  }
  const Quality q = quality(world, triangulate(map, {7, 1}));
  EXPECT_GT(q.right, 60);
  EXPECT_LT(q.median_error, 0.1);
}

TEST(Triangulate, TheNewKeyframeIsTheReferenceAndTheMapStaysValid) {
  const SyntheticMap world(silent({.keyframes = 5, .step = 0.2}));
  Map map = built(world);
  const DeltaSummary summary = apply_delta(map, triangulate(map, {7, 4}));
  EXPECT_GT(summary.landmarks_made, 30);
  EXPECT_EQ(summary.dropped, 0);
  map.landmarks.for_each([](LandmarkId, const Landmark& l) {
    EXPECT_EQ(l.reference, (KeyframeId{7, 4}));
  });
  EXPECT_THAT(check_invariants(map), IsEmpty());
  EXPECT_THAT(triangulate(map, {7, 99}).new_landmarks, IsEmpty());  // no such keyframe
}

TEST(Triangulate, FeaturesWithALandmarkAreLeftAlone) {
  const SyntheticMap world({.keyframes = 4});
  Map map = built(world);
  for (const auto& made : triangulate(map, {7, 3}).new_landmarks)
    for (const Observation& o : made.observations)
      EXPECT_FALSE(map.keyframes.at(o.keyframe).landmarks[o.feature].is_valid());
}

TEST(Triangulate, ATurnedFeatureIsNoMatch) {
  const SyntheticMap world({.keyframes = 2, .sensor = Sensor::kMono, .step = 0.3});
  auto turned = std::make_shared<Keyframe>(*world.keyframes[1]);
  for (std::size_t f = 0; f < 10; ++f) turned->features.points[f].angle += 2.0f;
  Map map;
  apply_keyframe(map, world.keyframes[0]);
  apply_keyframe(map, turned);
  const MapDelta delta = triangulate(map, {7, 1});
  EXPECT_GT(delta.new_landmarks.size(), 40u);
  for (const auto& made : delta.new_landmarks) EXPECT_GE(made.observations[0].feature, 10);
}

TEST(Triangulate, TheSameAgainGivesTheSame) {
  const SyntheticMap world(silent({.keyframes = 6, .step = 0.2}));
  const Map map = built(world);
  const MapDelta first = triangulate(map, {7, 5}), second = triangulate(map, {7, 5});
  ASSERT_EQ(first.new_landmarks.size(), second.new_landmarks.size());
  for (std::size_t i = 0; i < first.new_landmarks.size(); ++i) {
    EXPECT_EQ(first.new_landmarks[i].position, second.new_landmarks[i].position);
    EXPECT_EQ(first.new_landmarks[i].observations, second.new_landmarks[i].observations);
  }
}

TEST(TwoView, CertaintyGrowsWithTheBaseline) {
  double last = 1e9;
  for (const double step : {0.05, 0.1, 0.4}) {
    const SyntheticMap world({.keyframes = 2, .sensor = Sensor::kMono, .step = step});
    const Map map = built(world);
    const KeyframeNode& a = map.keyframes.at({7, 0});
    const KeyframeNode& b = map.keyframes.at({7, 1});
    const View in_a = View::of(*a.keyframe, a.map_from_camera);
    const View in_b = View::of(*b.keyframe, b.map_from_camera);
    Feature fa = a.features().points[0], fb = fa;
    const Eigen::Vector3d point(0.3, 0.2, 3.0);
    const Eigen::Vector2d pa = a.rig().camera.project(in_a.camera_from_map * point);
    const Eigen::Vector2d pb = b.rig().camera.project(in_b.camera_from_map * point);
    fa.x = static_cast<float>(pa.x()), fa.y = static_cast<float>(pa.y());
    fb.x = static_cast<float>(pb.x()), fb.y = static_cast<float>(pb.y());
    const auto found = triangulate_two_views(in_a, fa, in_b, fb);
    ASSERT_TRUE(found);
    EXPECT_LT((found->position - point).norm(), 1e-3);
    EXPECT_LT(found->relative_sigma, last);
    last = found->relative_sigma;
  }
}

TEST(GridCache, ForgetsTheKeyframeUsedLongestAgo) {
  const SyntheticMap world({.keyframes = 3, .points = 50});
  GridCache grids(2);
  const auto first = grids.grid(*world.keyframes[0]);
  grids.grid(*world.keyframes[1]);
  EXPECT_EQ(grids.grid(*world.keyframes[0]), first);
  grids.grid(*world.keyframes[2]);  // takes the place of keyframe 1
  EXPECT_EQ(grids.size(), 2u);
  EXPECT_EQ(grids.grid(*world.keyframes[0]), first);
}

}  // namespace
}  // namespace cairn
