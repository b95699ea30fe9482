// Names of landmarks, from the server's map by way of its updates into a client's local map: both
// mean the same by them when landmarks are fused and names are used again.
#include <gtest/gtest.h>

#include "client/tracking/local_map.h"
#include "server/map/apply.h"
#include "server/map/map_editor.h"
#include "server/publish/publish.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

struct Pair {
  Pair() : world({.keyframes = 2, .points = 200, .epoch = 7}), view(7) {
    map.id = {1};
    for (const KeyframePtr& keyframe : world.keyframes) {
      apply_keyframe(map, keyframe);
      local.add_keyframe(keyframe, keyframe->odom_from_camera.pose());
    }
    tell();
    // Two landmarks that were made with the first keyframe.
    for (const LandmarkId& id : map.keyframes.at({7, 0}).landmarks)
      if (id.is_valid()) (from.is_valid() ? into : from) = id;
  }
  void tell(ClientView::Kind kind = ClientView::Kind::kChanges) {
    if (const auto update = view.difference(map, 2, kind)) local.apply(*update);
  }
  void fuse() {
    MapDelta delta = MapDelta::based_on(map);
    delta.fusions = {{from, into}};
    apply_delta(map, delta);
  }
  // The feature that the name stands for shows a landmark of its own again.
  void make_again() {
    const Observation maker{from.creator(), from.creator_feature()};
    MapEditor editor(map);
    editor.remove_observation(into, maker);
    ASSERT_TRUE(editor.insert_landmark(from, {1, 2, 3}, maker));
  }

  // One that is neither of both.
  LandmarkId third() const {
    for (const LandmarkId& id : map.keyframes.at({7, 0}).landmarks)
      if (id.is_valid() && id != from && id != into) return id;
    return {};
  }

  SyntheticMap world;
  Map map;
  ClientView view;
  LocalMap local;
  LandmarkId from, into;
};

TEST(Names, AFusedLandmarkIsFoundUnderItsNewName) {
  Pair pair;
  ASSERT_EQ(pair.local.find(pair.from)->id, pair.from);
  pair.fuse();
  pair.tell();
  ASSERT_TRUE(pair.local.find(pair.from));
  EXPECT_EQ(pair.local.find(pair.from)->id, pair.into);
}

TEST(Names, ANameThatIsUsedAgainMeansTheNewLandmark) {
  Pair pair;
  pair.fuse();
  pair.tell();
  ASSERT_NO_FATAL_FAILURE(pair.make_again());
  pair.tell();
  ASSERT_TRUE(pair.local.find(pair.from));
  EXPECT_EQ(pair.local.find(pair.from)->id, pair.from);
  EXPECT_EQ(pair.local.find(pair.from)->position, Eigen::Vector3d(1, 2, 3));
}

// Used again and fused into another landmark than before, and the client has not heard of it.
TEST(Names, ARefreshForgetsWhatOldNamesMeant) {
  Pair pair;
  pair.fuse();
  pair.tell();
  ASSERT_NO_FATAL_FAILURE(pair.make_again());
  const LandmarkId third = pair.third();
  pair.into = third;
  pair.fuse();
  pair.tell(ClientView::Kind::kRefresh);
  ASSERT_TRUE(pair.local.find(pair.from));
  EXPECT_EQ(pair.local.find(pair.from)->id, third);
}

}  // namespace
}  // namespace cairn
