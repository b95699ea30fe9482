#include "server/verify/verify.h"

#include <gtest/gtest.h>

#include "tests/unit/server/verify/place_world.h"

namespace cairn {
namespace {

// Where the second visit stands: to the side and turned.
const Rigid3 kBeside{so3_exp({0.02, 0.15, 0.03}), {0.3, 0.05, 0.2}};
const Rigid3 kElsewhere{so3_exp({0.2, 1.2, -0.1}), {11, -2, 30}};

// What two clients made of two rooms, which may be one.
struct Visits {
  Visits(const Room& of_a, const Room& of_b, VisitOptions b_options = {})
      : a(map, of_a, {.epoch = 7}), b(map, of_b, second(std::move(b_options))) {}
  static VisitOptions second(VisitOptions o) {
    o.epoch = 9 + o.epoch;
    o.room_from_first = kBeside;
    o.map_from_room = kElsewhere;
    return o;
  }
  Verification verify(const VerifyOptions& options = {}) const {
    return verify_loop(map, b.id(2), a.id(2), options);
  }
  Sim3 true_candidate_from_query() const {
    Rigid3 truth = a.room_from_camera(2).inverse() * b.room_from_camera(2);
    return Sim3(truth);
  }
  Map map;
  Visit a, b;
};

std::string figures(const Verification& v) {
  return v.why + " (matches " + std::to_string(v.matches) + ", consensus " +
         std::to_string(v.consensus) + ", grown " + std::to_string(v.grown) + ", cells " +
         std::to_string(v.cells_query) + "/" + std::to_string(v.cells_candidate) +
         ", contradicted " + std::to_string(v.contradicted) + ", found " + std::to_string(v.found) +
         ", distinctive " + std::to_string(v.distinctive) + ", rival " + std::to_string(v.rival) +
         ")";
}

Room cluttered(std::uint64_t seed, int points = 900) {
  Room room;
  add_clutter(room, seed, points, {-3, -2, 2}, {4, 2, 5});
  return room;
}

void expect_true_loop(const Visits& visits, const Verification& v, double rotation,
                      double translation) {
  ASSERT_TRUE(v.loop) << figures(v);
  const Sim3 error = visits.true_candidate_from_query().inverse() * v.loop->candidate_from_query;
  EXPECT_LT(so3_log(error.rotation).norm(), rotation) << figures(v);
  EXPECT_LT(error.translation.norm(), translation) << figures(v);
  int right = 0;
  for (const auto& pair : v.loop->same)
    right += visits.b.point_of(pair.of_query) == visits.a.point_of(pair.of_candidate) ? 1 : 0;
  EXPECT_GE(right, static_cast<int>(0.98 * static_cast<double>(v.loop->same.size())));
  EXPECT_EQ(v.loop->inliers, static_cast<int>(v.loop->same.size()));
}

TEST(VerifyLoop, FindsATruePlaceWithItsTransform) {
  const Room room = cluttered(1);
  const Visits visits(room, room);
  const Verification v = visits.verify();
  expect_true_loop(visits, v, 0.003, 0.01);
  EXPECT_GT(v.loop->inliers, 200) << figures(v);
  EXPECT_EQ(v.loop->query, visits.b.id(2));
  EXPECT_EQ(v.loop->candidate, visits.a.id(2));
  EXPECT_EQ(v.loop->candidate_from_query.scale, 1.0);
}

TEST(VerifyLoop, FindsItAmongManyWrongDescriptors) {
  const Room room = cluttered(2);
  const Visits visits(room, room, {.wrong_descriptors = 0.4});
  expect_true_loop(visits, visits.verify(), 0.005, 0.02);
}

TEST(VerifyLoop, FindsItFromNoisyDepth) {
  const Room room = cluttered(3);
  const Visits visits(room, room, {.pixel_noise = 1.0, .disparity_noise = 0.8});
  expect_true_loop(visits, visits.verify(), 0.006, 0.025);
}

TEST(VerifyLoop, FindsTheScaleWhereItIsFree) {
  const Room room = cluttered(4);
  const Visits visits(room, room, {.scale = 0.5});
  EXPECT_FALSE(visits.verify().loop);
  const Verification v = visits.verify({.fix_scale = false});
  ASSERT_TRUE(v.loop) << figures(v);
  EXPECT_NEAR(v.loop->candidate_from_query.scale, 2, 0.01);
  EXPECT_LT(
      (v.loop->candidate_from_query.translation - visits.true_candidate_from_query().translation)
          .norm(),
      0.02);
}

TEST(VerifyLoop, EachLandmarkIsInOnePairAtMost) {
  const Room room = cluttered(5);
  const Verification v = Visits(room, room).verify();
  ASSERT_TRUE(v.loop);
  std::set<LandmarkId> query, candidate;
  for (const auto& pair : v.loop->same) {
    EXPECT_TRUE(query.insert(pair.of_query).second);
    EXPECT_TRUE(candidate.insert(pair.of_candidate).second);
  }
  EXPECT_TRUE(std::is_sorted(v.loop->same.begin(), v.loop->same.end()));
}

class VerifySeeds : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, VerifySeeds, testing::Range<std::uint64_t>(1, 21));

TEST_P(VerifySeeds, AnotherPlaceIsRejected) {
  const Visits visits(cluttered(10 * GetParam()), cluttered(10 * GetParam() + 1));
  EXPECT_FALSE(visits.verify().loop) << figures(visits.verify());
}

// The poster fills a good part of the image, and something else is around it each time.
TEST_P(VerifySeeds, SamePosterOnTwoWallsIsRejected) {
  Room a, b;
  for (Room* room : {&a, &b}) {
    add_poster(*room, 7 * GetParam(), {0.3, 0, 2.5}, 1.2, 300);
    add_clutter(*room, GetParam() + (room == &a ? 100 : 200), 500, {-3, -2, 2.4}, {4, 2, 2.6});
    std::erase_if(*room, [&](const RoomPoint& p) {
      return &p - room->data() >= 300 && std::abs(p.position.x() - 0.3) < 0.6 &&
             std::abs(p.position.y()) < 0.6;
    });
  }
  const Visits visits(a, b, {.epoch = GetParam()});
  const Verification v = visits.verify();
  EXPECT_FALSE(v.loop) << figures(v);
  EXPECT_GE(v.consensus, 40) << "the poster must be found, or nothing is tested";
}

TEST_P(VerifySeeds, BrickWallIsRejected) {
  Room wall;
  add_brick_wall(wall, GetParam(), 2.5, 7, 3);
  const Visits visits(wall, wall, {.epoch = GetParam(), .flipped_bits = 20});
  EXPECT_FALSE(visits.verify().loop) << figures(visits.verify());
}

TEST(VerifyLoop, LonePosterOnABareWallIsRejected) {
  Room a;
  add_poster(a, 5, {0.3, 0, 2.5}, 1.4, 500);
  const Visits visits(a, a);
  const Verification v = visits.verify();
  EXPECT_FALSE(v.loop);
  EXPECT_NE(v.why.find("flat"), std::string::npos) << figures(v);
}

// Dirt makes each brick's points differ a little.
void make_dirty(Room& room, std::uint64_t dirt, int bits) {
  synthetic::Random random(dirt);
  for (RoomPoint& point : room)
    for (int i = 0; i < bits; ++i) {
      const auto bit = static_cast<unsigned>(random.integer(256));
      point.descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
    }
}

Room dirty_wall(std::uint64_t bricks, std::uint64_t dirt, int bits) {
  Room wall;
  add_brick_wall(wall, bricks, 2.5, 7, 3);
  make_dirty(wall, dirt, bits);
  return wall;
}

// A print on a wall to the right, x = centre.x.
void add_poster_sideways(Room& room, std::uint64_t design, const Eigen::Vector3d& centre,
                         double size, int count) {
  Room poster;
  add_poster(poster, design, {0, 0, 0}, size, count);
  for (RoomPoint point : poster) {
    point.position = centre + Eigen::Vector3d(0, point.position.y(), -point.position.x());
    room.push_back(point);
  }
}

// The same prints along two walls of a corner, each seen at an angle of its own, and next to
// nothing else. All that is in common is neither flat nor small, and a shift along one wall
// explains that one only.
TEST_P(VerifySeeds, EqualPostersAlongTheWallsOfACornerAreRejected) {
  Room a, b;
  for (Room* room : {&a, &b}) {
    for (const double x : {-2.2, -1.1, 0.0}) add_poster(*room, GetParam(), {x, 0, 4.4}, 0.8, 100);
    for (const double z : {3.7, 2.6}) add_poster_sideways(*room, GetParam(), {1.5, 0, z}, 0.8, 100);
    make_dirty(*room, GetParam(), 14);
    add_clutter(*room, GetParam() + (room == &a ? 100 : 200), 25, {-3, -2, 3}, {1.4, 2, 4.3});
  }
  const Visits visits(a, b, {.epoch = GetParam(), .flipped_bits = 4});
  const Verification v = visits.verify();
  EXPECT_FALSE(v.loop) << figures(v);
  EXPECT_GE(v.grown, 150) << "the posters must be found, or nothing is tested";
  // What else there is does not contradict; only that it repeats speaks against it.
  VerifyOptions credulous;
  credulous.max_rival = credulous.max_rival_votes = 1;
  EXPECT_TRUE(visits.verify(credulous).loop) << figures(visits.verify(credulous));
}

TEST_P(VerifySeeds, AnotherWallOfTheSameBricksIsRejected) {
  const Room a = dirty_wall(GetParam(), 1, 12), b = dirty_wall(GetParam(), 2, 12);
  const Visits visits(a, b, {.epoch = GetParam(), .flipped_bits = 6});
  EXPECT_FALSE(visits.verify().loop) << figures(visits.verify());
}

TEST(VerifyLoop, WallIsFoundAgainWhereItsDirtTellsBricksApart) {
  const Room wall = dirty_wall(3, 1, 20);
  const Visits visits(wall, wall, {.flipped_bits = 4});
  expect_true_loop(visits, visits.verify(), 0.003, 0.01);
}

TEST(VerifyLoop, TwoIdenticalPlacesOnTheCandidatesSideAreRejected) {
  // The same furniture twice, side by side; the query saw one of them.
  Room once, twice;
  add_clutter(once, 1, 400, {-1, -1, 2}, {1, 1, 3});
  for (RoomPoint point : once) {
    point.position.x() -= 0.8;
    twice.push_back(point);
    point.position.x() += 2.4;
    twice.push_back(point);
  }
  const Verification v = Visits(twice, once).verify();
  EXPECT_FALSE(v.loop) << figures(v);
}

TEST(VerifyLoop, FewInliersAreRejected) {
  const Room room = cluttered(6, 60);
  const Visits visits(room, room);
  const Verification v = visits.verify();
  EXPECT_FALSE(v.loop) << figures(v);
  EXPECT_NE(v.why.find("fewer than"), std::string::npos) << v.why;
}

TEST(VerifyLoop, ContradictingSurroundingsAreRejected) {
  // A third of the room is the same, all else is new, at all depths.
  Room a = cluttered(7), b = cluttered(8);
  Room common;
  add_clutter(common, 9, 300, {-0.5, -0.7, 2.2}, {1.0, 0.7, 3.2});
  a.insert(a.end(), common.begin(), common.end());
  b.insert(b.end(), common.begin(), common.end());
  const Verification v = Visits(a, b).verify();
  EXPECT_FALSE(v.loop) << figures(v);
  EXPECT_NE(v.why.find("surroundings"), std::string::npos) << figures(v);
}

TEST(VerifyLoop, GivesTheSameResultEachTime) {
  const Room room = cluttered(2);
  const Visits visits(room, room, {.wrong_descriptors = 0.4});
  const Verification v = visits.verify(), again = visits.verify();
  ASSERT_TRUE(v.loop && again.loop);
  EXPECT_EQ(v.loop->same, again.loop->same);
  EXPECT_EQ(v.loop->candidate_from_query.translation, again.loop->candidate_from_query.translation);
}

TEST(VerifyLoop, KeyframesThatAreGoneOrNeighboursAreNoLoop) {
  const Room room = cluttered(1);
  const Visits visits(room, room);
  EXPECT_FALSE(verify_loop(visits.map, {99, 1}, visits.a.id(0), {}).loop);
  EXPECT_FALSE(verify_loop(visits.map, visits.a.id(0), visits.a.id(0), {}).loop);
  const Verification v = verify_loop(visits.map, visits.a.id(1), visits.a.id(0), {});
  EXPECT_FALSE(v.loop);
  EXPECT_FALSE(v.why.empty());
}

}  // namespace
}  // namespace cairn
