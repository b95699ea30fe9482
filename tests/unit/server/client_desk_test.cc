#include "server/client_desk.h"

#include <gtest/gtest.h>

#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

const ClientId kClient{"walker", 7};

class ClientDeskTest : public ::testing::Test {
 protected:
  ClientDeskTest() : world_({.keyframes = 4, .points = 200}), writer_(first_map()) {}

  static Map first_map() {
    Map map;
    map.id = {42};
    return map;
  }
  std::shared_ptr<ClientDesk> make(const ClientId& client) {
    return std::make_shared<ClientDesk>(client, writer_);
  }
  void map_keyframe(ClientDesk& desk, std::size_t i) {
    writer_.submit(world_.keyframes[i]);
    desk.extend(world_.keyframes[i]->id);
    MapDelta mapped = MapDelta::based_on(*writer_.snapshot());
    mapped.mapped_keyframes = {world_.keyframes[i]->id};
    writer_.submit(std::move(mapped));
  }
  // What the desk sends; nothing when there is nothing to say. `accepted`: whether it gets through.
  std::optional<MapUpdate> tell(ClientDesk& desk, bool accepted = true) {
    std::optional<MapUpdate> sent;
    const Status told =
        desk.tell(*writer_.snapshot(), false, [&](const MapUpdate& update) -> Status {
          sent = update;
          if (!accepted) return {ErrorCode::kUnavailable, "the writer is full"};
          return {};
        });
    EXPECT_EQ(told.ok(), accepted);
    return sent;
  }

  SyntheticMap world_;
  MapWriter writer_;
};

TEST_F(ClientDeskTest, AnUpdateThatDidNotGetThroughIsToldAnew) {
  const auto desk = make(kClient);
  map_keyframe(*desk, 0);
  ASSERT_TRUE(tell(*desk)->is_refresh()) << "the first one";
  map_keyframe(*desk, 1);
  EXPECT_FALSE(tell(*desk)->is_refresh());
  map_keyframe(*desk, 2);
  EXPECT_FALSE(tell(*desk, /*accepted=*/false)->is_refresh());
  map_keyframe(*desk, 3);
  const auto again = tell(*desk, false);
  EXPECT_TRUE(again->is_refresh());
  EXPECT_EQ(again->keyframes.size(), 4u);
  EXPECT_TRUE(tell(*desk)->is_refresh()) << "and until one gets through";
  EXPECT_FALSE(tell(*desk)) << "nothing new";
}

TEST_F(ClientDeskTest, ARefreshThatWasAskedForComesOnce) {
  const auto desk = make(kClient);
  map_keyframe(*desk, 0);
  tell(*desk);
  desk->refresh();
  EXPECT_TRUE(tell(*desk)->is_refresh());
  EXPECT_FALSE(tell(*desk));
}

TEST_F(ClientDeskTest, GoesOnWithTheCountOfTheMap) {
  map_keyframe(*make(kClient), 0);
  map_keyframe(*make(kClient), 1);
  writer_.submit(world_.keyframes[2]);  // not mapped
  EXPECT_EQ(tell(*make(kClient))->mapped_keyframes, 2u);
}

TEST_F(ClientDeskTest, DesksOfClientsThatAreThereStay) {
  ClientDesks desks([this](const ClientId& client) { return make(client); });
  const auto desk = desks.join(kClient);
  desks.release(kClient);
  EXPECT_EQ(desks.of(kClient), desk);
  EXPECT_TRUE(desks.is_there(kClient));
  EXPECT_EQ(desks.leave(kClient), desk);
  EXPECT_EQ(desks.of(kClient), desk) << "there may be work on its keyframes";
  EXPECT_EQ(desks.join(kClient), desk) << "back before it was forgotten";
  desks.release(kClient);
  EXPECT_EQ(desks.size(), 1u);
}

TEST_F(ClientDeskTest, DesksOfRunsThatAreNotThereAreFreed) {
  ClientDesks desks([this](const ClientId& client) { return make(client); });
  desks.of({"walker", 6});  // an earlier run whose keyframes came out of the outbox
  desks.join(kClient);
  desks.leave(kClient);
  EXPECT_FALSE(desks.leave({"stranger", 5}));
  EXPECT_EQ(desks.size(), 2u);
  desks.release(kClient);
  desks.release({"walker", 6});
  EXPECT_EQ(desks.size(), 0u);
}

}  // namespace
}  // namespace cairn
