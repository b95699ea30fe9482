// Loops and merges of parts that have no scale of their own: cameras without depth.
#include <cmath>

#include <gmock/gmock.h>

#include "server/loop_closer.h"
#include "server/map/connected.h"
#include "server/map/invariants.h"
#include "server/map/map_editor.h"
#include "server/optimize/local_ba.h"
#include "server/place/default_vocabulary.h"
#include "tests/unit/server/verify/place_world.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

// Where the second visit stands: to the side and turned.
const Rigid3 kBeside{so3_exp({0.02, 0.15, 0.03}), {0.3, 0.05, 0.2}};
const Rigid3 kElsewhere{so3_exp({0.2, 1.2, -0.1}), {11, -2, 30}};

std::shared_ptr<const Vocabulary> vocabulary() {
  static const auto loaded = std::make_shared<const Vocabulary>(*default_vocabulary());
  return loaded;
}

Room room() {
  Room all;
  add_clutter(all, 1, 1200, {-3, -2, 2}, {5, 2, 5});
  return all;
}

VisitOptions visit(std::uint64_t epoch, Sensor sensor, double scale) {
  return {.epoch = epoch, .step = 0.25, .scale = scale, .pixel_noise = 0.3, .sensor = sensor};
}

// Two clients in one room, the first one's part of the map the older one.
struct Visits {
  Visits(const VisitOptions& of_first, const VisitOptions& of_second,
         const Rigid3& second_from_room)
      : a(map, the_room, of_first), b(map, the_room, second(of_second, second_from_room)) {}
  static VisitOptions second(VisitOptions o, const Rigid3& map_from_room) {
    o.room_from_first = kBeside;
    o.map_from_room = map_from_room;
    return o;
  }
  void close(KeyframeId query) {
    LoopCloserHooks hooks;
    hooks.solve = [](const Map& m, const LocalWindow& window, std::stop_token stop) {
      return solve_local_ba(m, window, {}, nullptr, stop);
    };
    hooks.changed = [] {};
    MapWriter writer(map);
    LoopCloser closer(writer, vocabulary(), {}, hooks);
    closer.offer(query);
    closer.wait_idle();
    loops = static_cast<int>(closer.counters().loops);
    merges = static_cast<int>(closer.counters().merges);
    closed = writer.snapshot();
  }
  // How far the second visit's first camera is from where it stood as seen from the first visit's,
  // in the first one's metres.
  double gap() const {
    const Rigid3 found = closed->keyframes.at(a.id(0)).map_from_camera.inverse() *
                         closed->keyframes.at(b.id(0)).map_from_camera;
    return (found.translation / a.options.scale - kBeside.translation).norm();
  }
  double moved(const Visit& visit, int k) const {
    return (closed->keyframes.at(visit.id(k)).map_from_camera.translation -
            map.keyframes.at(visit.id(k)).map_from_camera.translation)
        .norm();
  }

  const Room the_room = room();
  Map map;
  Visit a, b;
  Snapshot closed;
  int loops = 0, merges = 0;
};

TEST(LoopScale, OfTwoPartsWithoutDepthTheOlderOneGivesTheScale) {
  Visits run(visit(7, Sensor::kMono, 1), visit(9, Sensor::kMono, 0.4), kElsewhere);
  run.close(run.b.id(2));
  ASSERT_EQ(run.merges, 1);
  EXPECT_LT(run.gap(), 0.05);
  for (int k = 0; k < 5; ++k) {
    EXPECT_LT(run.moved(run.a, k), 0.03) << k;
    EXPECT_NEAR(run.closed->keyframes.at(run.b.id(k)).unit, 2.5, 0.1);
    EXPECT_EQ(run.closed->keyframes.at(run.a.id(k)).unit, 1);
  }
  EXPECT_THAT(run.closed->loops[0].moved, ElementsAre(9u));
  EXPECT_NEAR(run.closed->loops[0].new_map_from_old_map.scale, 2.5, 0.1);
  EXPECT_THAT(connected_keyframes(*run.closed, run.a.id(0)), SizeIs(10));
  EXPECT_THAT(check_invariants(*run.closed), IsEmpty());
}

// Whichever comes first, and whichever recognises the other.
TEST(LoopScale, ThePartWithDepthKeepsFrameAndScale) {
  for (const bool depth_first : {true, false})
    for (const bool older_asks : {true, false}) {
      const VisitOptions depth = visit(7, Sensor::kRgbd, 1), mono = visit(9, Sensor::kMono, 0.4);
      Visits run(depth_first ? depth : mono, depth_first ? mono : depth, kElsewhere);
      run.close(older_asks ? run.a.id(2) : run.b.id(2));
      const std::string which =
          std::to_string(depth_first) + " older asks " + std::to_string(older_asks);
      ASSERT_EQ(run.merges, 1) << which;
      const Visit& with = depth_first ? run.a : run.b;
      const Visit& without = depth_first ? run.b : run.a;
      for (int k = 0; k < 5; ++k) {
        EXPECT_LT(run.moved(with, k), 0.03) << which;
        EXPECT_GT(run.moved(without, k), 1) << which;
        EXPECT_NEAR(run.closed->keyframes.at(without.id(k)).unit, 2.5, 0.1) << which;
        EXPECT_EQ(run.closed->keyframes.at(with.id(k)).unit, 1) << which;
      }
      const Rigid3 first_from_last =
          run.closed->keyframes.at(without.id(0)).map_from_camera.inverse() *
          run.closed->keyframes.at(without.id(4)).map_from_camera;
      EXPECT_NEAR(first_from_last.translation.norm(), 1.0, 0.03) << which;
      EXPECT_THAT(run.closed->loops[0].moved, ElementsAre(9u)) << which;
      EXPECT_TRUE(is_metric(*run.closed, without.id(0)));
    }
}

// Two with depth are held against each other in metres: one that is told too large is not believed.
TEST(LoopScale, BetweenPartsWithDepthTheScaleIsNoQuestion) {
  Visits run(visit(7, Sensor::kRgbd, 1), visit(9, Sensor::kRgbd, 0.4), kElsewhere);
  run.close(run.b.id(2));
  EXPECT_EQ(run.merges, 0);
}

// The second visit goes on where the first one ended, and has drifted in scale on the way.
struct Drifted : Visits {
  Drifted(double scale, const Eigen::Vector3d& shift)
      : Visits(visit(7, Sensor::kMono, 1), visit(9, Sensor::kMono, scale),
               Rigid3({1, 0, 0, 0}, shift)) {
    MapEditor(map).graft_tree(b.id(0), a.id(4));
  }
};

TEST(LoopScale, ALoopInAPartWithoutDepthDistributesTheDriftInScale) {
  Drifted run(0.8, {0.05, 0.02, 0.03});
  run.close(run.b.id(2));
  EXPECT_EQ(run.loops, 1);
  EXPECT_EQ(run.merges, 0);
  const double first = run.closed->keyframes.at(run.a.id(0)).unit,
               last = run.closed->keyframes.at(run.b.id(2)).unit;
  EXPECT_EQ(first, 1);
  EXPECT_GT(last, 1.03);
  // Where both ends meet their maps are of one size.
  const double of_a = run.closed->keyframes.at(run.a.id(2)).unit;
  EXPECT_NEAR(last / of_a, 1 / 0.8, 0.03);
  EXPECT_THAT(check_invariants(*run.closed), IsEmpty());
}

// So near to its place that with depth it would be no loop.
TEST(LoopScale, WhatIsAtItsPlaceButOfAnotherSizeIsALoopToo) {
  Drifted run(0.96, {0.02, 0, 0});
  run.close(run.b.id(2));
  EXPECT_EQ(run.loops, 1);
}

}  // namespace
}  // namespace cairn
