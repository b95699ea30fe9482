#include "server/verify/relocalise.h"

#include <gtest/gtest.h>

#include "tests/unit/server/verify/place_world.h"

namespace cairn {
namespace {

// Where the lost client stands: to the side of the first keyframe and turned.
const Rigid3 kBeside{so3_exp({0.02, 0.15, 0.03}), {0.3, 0.05, 0.2}};

Room cluttered(std::uint64_t seed, int points = 900) {
  Room room;
  add_clutter(room, seed, points, {-3, -2, 2}, {4, 2, 5});
  return room;
}

// What somebody has mapped of one room, and what a lost client sees of another one, which may be
// the same.
struct Lost {
  Lost(const Room& mapped_room, const Room& seen_room, VisitOptions view_options = {})
      : mapped(map, mapped_room, {.epoch = 7}), view(view_of(seen_room, view_options)) {}

  static Keyframe view_of(const Room& room, VisitOptions options) {
    options.epoch = 90 + options.epoch;
    options.keyframes = 1;
    options.room_from_first = kBeside;
    Map own;
    const Visit visit(own, room, options);
    Keyframe view = *own.keyframes.at(visit.id(0)).keyframe;
    view.matches.clear();
    return view;
  }
  Locating locate(const LocateOptions& options = {}) const {
    return cairn::locate(map, view, FeatureGrid(view.features, view.rig->camera), mapped.id(2),
                         options);
  }

  Map map;
  Visit mapped;
  Keyframe view;
};

std::string figures(const Locating& l) {
  return l.why + " (matches " + std::to_string(l.matches) + ", consensus " +
         std::to_string(l.consensus) + ", inliers " + std::to_string(l.inliers) + ", cells " +
         std::to_string(l.cells) + ", found " + std::to_string(l.found) + ", contradicted " +
         std::to_string(l.contradicted) + ")";
}

// The map's frame is that of the room.
void expect_found(const Locating& l, double rotation, double translation) {
  ASSERT_TRUE(l.location) << figures(l);
  const Rigid3 error = kBeside.inverse() * l.location->map_from_camera;
  EXPECT_LT(rotation_angle(error), rotation) << figures(l);
  EXPECT_LT(error.translation.norm(), translation) << figures(l);
}

TEST(Locate, FindsAViewInTheMap) {
  const Room room = cluttered(1);
  const Lost lost(room, room);
  const Locating l = lost.locate();
  expect_found(l, 0.003, 0.01);
  EXPECT_GT(l.inliers, 200) << figures(l);
  ASSERT_FALSE(l.location->around.empty());
  EXPECT_EQ(l.location->around.front().epoch, 7u);
  for (std::size_t i = 1; i < l.location->matches.size(); ++i)
    ASSERT_LT(l.location->matches[i - 1].feature, l.location->matches[i].feature);
}

TEST(Locate, MatchesAreOfWhatTheFeaturesShow) {
  const Room room = cluttered(1);
  const Lost lost(room, room, {.pixel_noise = 0.1, .seen = 1});
  const Locating l = lost.locate();
  ASSERT_TRUE(l.location) << figures(l);
  int right = 0;
  for (const LandmarkMatch& m : l.location->matches) {
    const int point = lost.mapped.point_of(m.landmark);
    ASSERT_GE(point, 0);
    const Eigen::Vector3d p = kBeside.inverse() * room[static_cast<std::size_t>(point)].position;
    const Eigen::Vector2d pixel = lost.view.rig->camera.project(p);
    right += (pixel - lost.view.features.points[m.feature].pixel()).norm() < 2 ? 1 : 0;
  }
  EXPECT_GE(right, static_cast<int>(0.98 * static_cast<double>(l.location->matches.size())));
}

TEST(Locate, FindsItAmongManyWrongDescriptors) {
  const Room room = cluttered(2);
  expect_found(Lost(room, room, {.wrong_descriptors = 0.5}).locate(), 0.005, 0.02);
}

TEST(Locate, NeedsNoDepth) {
  const Room room = cluttered(3);
  Lost lost(room, room);
  for (Feature& f : lost.view.features.points) f.disparity = 0;
  expect_found(lost.locate(), 0.005, 0.02);
}

TEST(Locate, GivesTheSameResultEachTime) {
  const Room room = cluttered(2);
  const Lost lost(room, room, {.wrong_descriptors = 0.4});
  const Locating l = lost.locate(), again = lost.locate();
  ASSERT_TRUE(l.location && again.location);
  EXPECT_EQ(l.location->matches, again.location->matches);
  EXPECT_EQ(l.location->map_from_camera.translation, again.location->map_from_camera.translation);
}

TEST(Locate, FewInliersAreRejected) {
  const Room room = cluttered(6, 60);
  const Locating l = Lost(room, room).locate();
  EXPECT_FALSE(l.location) << figures(l);
  EXPECT_NE(l.why.find("fewer than"), std::string::npos) << l.why;
}

TEST(Locate, WhatTheMapDoesNotHaveIsNowhere) {
  const Room room = cluttered(1);
  Lost lost(room, room);
  const FeatureGrid grid(lost.view.features, lost.view.rig->camera);
  EXPECT_FALSE(locate(lost.map, lost.view, grid, {99, 1}, {}).location);
  lost.view.features = {};
  EXPECT_FALSE(lost.locate().location);
}

// On whichever wall it hangs.
TEST(Locate, AViewOfALonePosterIsRejected) {
  Room a;
  add_poster(a, 5, {0.3, 0, 2.5}, 1.4, 500);
  const Locating l = Lost(a, a).locate();
  EXPECT_FALSE(l.location);
  EXPECT_NE(l.why.find("poster"), std::string::npos) << figures(l);
}

TEST(Locate, OneOfTwoEqualPlacesSideBySideIsRejected) {
  Room once, twice;
  add_clutter(once, 1, 400, {-1, -1, 2}, {1, 1, 3});
  for (RoomPoint point : once) {
    point.position.x() -= 0.8;
    twice.push_back(point);
    point.position.x() += 2.4;
    twice.push_back(point);
  }
  const Locating l = Lost(twice, once).locate();
  EXPECT_FALSE(l.location) << figures(l);
}

class LocateSeeds : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, LocateSeeds, testing::Range<std::uint64_t>(1, 11));

TEST_P(LocateSeeds, AnotherPlaceIsRejected) {
  const Lost lost(cluttered(10 * GetParam()), cluttered(10 * GetParam() + 1));
  EXPECT_FALSE(lost.locate().location) << figures(lost.locate());
}

// The poster fills a good part of the image, and something else is around it each time.
TEST_P(LocateSeeds, SamePosterOnAnotherWallIsRejected) {
  Room a, b;
  for (Room* room : {&a, &b}) {
    add_poster(*room, 7 * GetParam(), {0.3, 0, 2.5}, 1.2, 300);
    Room wall;
    add_clutter(wall, GetParam() + (room == &a ? 100 : 200), 500, {-3, -2, 2.4}, {4, 2, 2.6});
    for (const RoomPoint& p : wall)
      if (std::abs(p.position.x() - 0.3) >= 0.6 || std::abs(p.position.y()) >= 0.6)
        room->push_back(p);
  }
  const Locating l = Lost(a, b, {.epoch = GetParam()}).locate();
  EXPECT_FALSE(l.location) << figures(l);
  EXPECT_GE(l.consensus, 40) << "the poster must be found, or nothing is tested";
}

TEST_P(LocateSeeds, BrickWallIsRejected) {
  Room wall;
  add_brick_wall(wall, GetParam(), 2.5, 7, 3);
  const Lost lost(wall, wall, {.epoch = GetParam(), .flipped_bits = 20});
  EXPECT_FALSE(lost.locate().location) << figures(lost.locate());
}

}  // namespace
}  // namespace cairn
