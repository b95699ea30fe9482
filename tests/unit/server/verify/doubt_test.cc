// Each doubt on its own: transforms that fit what they were made from, put before doubt() as if the
// earlier steps of verification had let them through.
#include "server/verify/doubt.h"

#include <gtest/gtest.h>

#include "tests/unit/server/verify/place_world.h"

namespace cairn {
namespace {

// Two visits from the same spot, and what doubt() says when the query is taken to be `shift` metres
// from where it is.
struct Suspect {
  Suspect(const Room& of_candidate, const Room& of_query, const Eigen::Vector3d& shift,
          const VerifyOptions& options = {}) {
    Map map;
    const Visit a(map, of_candidate, {.epoch = 7, .disparity_noise = 0.1});
    const Visit b(map, of_query, {.epoch = 9, .disparity_noise = 0.1});
    const Side candidate = make_side(map, {a.id(2), a.id(0), a.id(1), a.id(3), a.id(4)}, {});
    const Side query = make_side(map, {b.id(2), b.id(0), b.id(1), b.id(3), b.id(4)}, {});
    const Sim3 transform(Eigen::Quaterniond::Identity(), shift, 1);
    const Grown grown = grow(query, candidate, transform, options);
    v.grown = static_cast<int>(grown.pairs.size());
    why = doubt(query, candidate, match_sides(query, candidate, options), transform, grown, options,
                v);
  }
  bool says(const char* word) const { return why.find(word) != std::string::npos; }

  Verification v;
  std::string why;
};

Room cluttered(std::uint64_t seed, int points = 900) {
  Room room;
  add_clutter(room, seed, points, {-3, -2, 2}, {4, 2, 5});
  return room;
}

// The wall of a room that has depth elsewhere, so that flatness alone does not decide.
Room brick_room() {
  Room room;
  add_brick_wall(room, 1, 2.5, 7, 3);
  add_brick_wall(room, 2, 3.5, 9, 4);
  return room;
}

TEST(Doubt, HasNoneOfATruePlace) {
  const Room room = cluttered(1);
  const Suspect suspect(room, room, {0, 0, 0});
  EXPECT_EQ(suspect.why, "");
  EXPECT_GT(suspect.v.found, 0.7);
  EXPECT_LT(suspect.v.contradicted, 0.02);
  EXPECT_GT(suspect.v.distinctive, 0.95);
  EXPECT_LT(suspect.v.rival, 0.05);
  EXPECT_LT(suspect.v.rival_votes, 0.2);
}

TEST(Doubt, OfBricksThatFitOneBrickFurtherOn) {
  const Room room = brick_room();
  const Suspect suspect(room, room, {0.25, 0, 0});
  EXPECT_GE(suspect.v.grown, 100) << "the shift must fit, or nothing is tested";
  EXPECT_TRUE(suspect.says("repeats") || suspect.says("another place")) << suspect.why;
}

TEST(Doubt, OfWhatFitsElsewhereAsWellEvenIfDistinctive) {
  // With the demand for distinctive inliers off, the other shifts of a brick must tell.
  const Room room = brick_room();
  const Suspect suspect(room, room, {0.25, 0, 0}, {.min_distinctive = 0});
  EXPECT_TRUE(suspect.says("another place")) << suspect.why;
  EXPECT_GT(suspect.v.rival_votes, 0.5);
}

TEST(Doubt, OfAPosterAmidOtherThings) {
  for (const int around : {250, 500, 1000}) {
    Room a, b;
    for (Room* room : {&a, &b}) {
      add_poster(*room, 5, {0.3, 0, 2.5}, 1.2, 300);
      Room others;
      add_clutter(others, room == &a ? 100 : 200, around, {-3, -2, 2.4}, {4, 2, 2.6});
      for (const RoomPoint& p : others)
        if (std::abs(p.position.x() - 0.3) > 0.6 || std::abs(p.position.y()) > 0.6)
          room->push_back(p);
    }
    // With the demand for depth off, the surroundings must tell.
    const Suspect suspect(a, b, {0, 0, 0}, {.min_flat_extent_m = 0});
    EXPECT_GE(suspect.v.grown, 200);
    EXPECT_TRUE(suspect.says("surroundings"))
        << suspect.why << " " << around << " contradicted " << suspect.v.contradicted;
  }
}

TEST(Doubt, OfAFlatSetNoLargerThanAPoster) {
  Room a;
  add_poster(a, 5, {0.3, 0, 2.5}, 1.4, 400);
  const Suspect suspect(a, a, {0, 0, 0});
  EXPECT_TRUE(suspect.says("flat")) << suspect.why;
}

TEST(Doubt, NotOfAFlatSetThatIsLarger) {
  Room a;
  add_clutter(a, 3, 900, {-3, -2, 2.5}, {4, 2, 2.5});
  EXPECT_EQ(Suspect(a, a, {0, 0, 0}).why, "");
}

TEST(Doubt, OfInliersInACornerOfTheImage) {
  Room a, b;
  add_clutter(a, 3, 200, {0.5, 0.4, 2.5}, {0.9, 0.8, 3.5});
  const Suspect suspect(a, a, {0, 0, 0});
  EXPECT_TRUE(suspect.says("parts of the images, fewer")) << suspect.why;
}

TEST(Doubt, NotWhereSomethingNewStandsBeforeIt) {
  // A board in front of a sixth of the scene: what is behind it can't be seen, and that is no
  // contradiction. The board itself is one: the other side should see it and does not.
  Room before = cluttered(4), after = before;
  add_clutter(after, 50, 1500, {-0.6, -2, 1.5}, {0.0, 2, 1.5});
  std::erase_if(after, [](const RoomPoint& p) {
    const double x = p.position.x() / p.position.z(), behind = p.position.z() > 1.6;
    return behind && x > -0.4 && x < 0.0;
  });
  EXPECT_EQ(Suspect(before, after, {0, 0, 0}).why, "");
}

}  // namespace
}  // namespace cairn
