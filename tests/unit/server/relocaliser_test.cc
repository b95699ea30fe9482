#include "server/relocaliser.h"

#include <future>

#include <gtest/gtest.h>

#include "common/wire/relocalise_codec.h"
#include "server/place/default_vocabulary.h"
#include "tests/unit/server/verify/place_world.h"

namespace cairn {
namespace {

using namespace std::chrono_literals;

const Rigid3 kBeside{so3_exp({0.02, 0.15, 0.03}), {0.3, 0.05, 0.2}};
const Rigid3 kElsewhere{so3_exp({0.2, 1.2, -0.1}), {11, -2, 30}};
const ClientId kLost{"lost", 500};

std::shared_ptr<const Vocabulary> vocabulary() {
  static const auto loaded = std::make_shared<const Vocabulary>(*default_vocabulary());
  return loaded;
}

Room cluttered(std::uint64_t seed) {
  Room room;
  add_clutter(room, seed, 700, {-3, -2, 2}, {4, 2, 5});
  return room;
}

// Several rooms, each mapped by a client of its own; the map has them in frames of their own.
struct World {
  explicit World(std::vector<Room> mapped) : rooms(std::move(mapped)) {
    map.id = {42};
    map.merge_epoch = 3;
    for (std::size_t i = 0; i < rooms.size(); ++i) {
      const Visit visit(map, rooms[i], {.epoch = 7 + i, .map_from_room = map_from_room(i)});
      for (int k = 0; k < visit.options.keyframes; ++k) index_keyframe(visit.id(k));
    }
  }
  void index_keyframe(KeyframeId id) {
    index.add(id, vocabulary()->words(map.keyframes.at(id).features().descriptors));
  }
  static Rigid3 map_from_room(std::size_t i) {
    return i == 0 ? Rigid3()
                  : Rigid3(kElsewhere.rotation, static_cast<double>(i) * kElsewhere.translation);
  }
  // What a lost client sees of a room.
  static KeyframePtr view_of(const Room& room, std::uint32_t number = 1) {
    Map own;
    const Visit visit(own, room,
                      {.epoch = kLost.epoch, .keyframes = 1, .room_from_first = kBeside});
    auto view = std::make_shared<Keyframe>(*own.keyframes.at(visit.id(0)).keyframe);
    view->id.sequence = number;
    view->matches.clear();
    return view;
  }
  RelocaliseAnswer ask(const Room& room) const {
    return relocalise(map, index, *vocabulary(), *view_of(room), {});
  }

  std::vector<Room> rooms;
  Map map;
  PlaceIndex index;
};

void expect_at(const RelocaliseAnswer& answer, const Rigid3& map_from_room) {
  ASSERT_TRUE(answer.found) << answer.why;
  const Rigid3 error = (map_from_room * kBeside).inverse() * answer.map_from_camera;
  EXPECT_LT(rotation_angle(error), 0.005);
  EXPECT_LT(error.translation.norm(), 0.02);
}

TEST(Relocalise, AnswersFromWhoeverHasMappedThePlace) {
  const World world({cluttered(1), cluttered(2), cluttered(3)});
  for (std::size_t i = 0; i < 3; ++i) {
    const RelocaliseAnswer answer = world.ask(world.rooms[i]);
    expect_at(answer, World::map_from_room(i));
    EXPECT_EQ(answer.reference.epoch, 7 + i);
    EXPECT_EQ(answer.epoch, kLost.epoch);
    EXPECT_EQ(answer.number, 1u);
    EXPECT_EQ(answer.map_from_reference.translation,
              world.map.keyframes.at(answer.reference).map_from_camera.translation);
  }
}

TEST(Relocalise, TellsTheMapAroundThePlace) {
  const World world({cluttered(1), cluttered(2)});
  const RelocaliseAnswer answer = world.ask(world.rooms[1]);
  ASSERT_TRUE(answer.found) << answer.why;
  EXPECT_EQ(answer.around.map, (MapId{42}));
  EXPECT_EQ(answer.around.merge_epoch, 3u);
  EXPECT_GT(answer.around.landmarks.size(), answer.matches.size());
  EXPECT_LE(answer.around.landmarks.size(), RelocaliseOptions{}.landmarks);
  const auto blob = wire::encode_answer("lost", answer);
  ASSERT_TRUE(blob) << blob.message();
  EXPECT_LT(blob->size(), 60'000u) << "more suffers on lossy links";
}

TEST(Relocalise, APlaceThatNobodyHasMappedIsNowhere) {
  const World world({cluttered(1), cluttered(2)});
  const RelocaliseAnswer answer = world.ask(cluttered(9));
  EXPECT_FALSE(answer.found);
  EXPECT_FALSE(answer.why.empty());
  EXPECT_TRUE(wire::encode_answer("lost", answer));
  EXPECT_FALSE(World({}).ask(cluttered(9)).found);
}

// The same room in two parts of the map, which nobody has joined yet: either place is right. Once
// they are known to belong together, one of the two must be wrong.
TEST(Relocalise, TwoPlacesThatLookTheSameAreNoAnswer) {
  World world({cluttered(1), cluttered(1)});
  const RelocaliseAnswer apart = world.ask(world.rooms[0]);
  EXPECT_TRUE(apart.found) << apart.why;
  LoopEdge way;
  way.query = {7, 0};
  way.candidate = {8, 0};
  world.map.loops.push_back(way);
  const RelocaliseAnswer joined = world.ask(world.rooms[0]);
  EXPECT_FALSE(joined.found);
  EXPECT_NE(joined.why.find("two places"), std::string::npos) << joined.why;
}

// Depth in metres says nothing in a part that has another unit; images alone do.
TEST(Relocalise, WhoHasDepthIsNotPlacedInAPartWithoutMetres) {
  World world({});
  const Room room = cluttered(1);
  const Visit visit(world.map, room,
                    {.epoch = 7, .step = 0.25, .pixel_noise = 0.3, .sensor = Sensor::kMono});
  for (int k = 0; k < visit.options.keyframes; ++k) world.index_keyframe(visit.id(k));
  EXPECT_FALSE(world.ask(room).found);
  auto blind = std::make_shared<Keyframe>(*World::view_of(room));
  auto rig = std::make_shared<Rig>(*blind->rig);
  rig->sensor = Sensor::kMono;
  rig->camera.baseline = rig->max_depth = 0;
  blind->rig = rig;
  for (Feature& f : blind->features.points) f.disparity = 0;
  world.map.keyframes.edit(visit.id(2))->unit = 3;  // merges have scaled it since
  const RelocaliseAnswer found = relocalise(world.map, world.index, *vocabulary(), *blind, {});
  ASSERT_TRUE(found.found) << found.why;
  EXPECT_EQ(found.map_from_reference.scale, found.reference == visit.id(2) ? 3 : 1);
}

TEST(Relocalise, IsTheSameEachTime) {
  const World world({cluttered(1), cluttered(2)});
  const RelocaliseAnswer a = world.ask(world.rooms[0]), b = world.ask(world.rooms[0]);
  ASSERT_TRUE(a.found && b.found);
  EXPECT_EQ(*wire::encode_answer("lost", a), *wire::encode_answer("lost", b));
}

// Answers in the order of their arrival.
struct Answers {
  Relocaliser::Send send() {
    return [this](const ClientId& client, const RelocaliseAnswer& answer, double) {
      std::lock_guard lock(mutex);
      all.emplace_back(client, answer);
      came.notify_all();
    };
  }
  std::size_t wait_for(std::size_t count) {
    std::unique_lock lock(mutex);
    came.wait_for(lock, 10s, [&] { return all.size() >= count; });
    return all.size();
  }
  std::mutex mutex;
  std::condition_variable came;
  std::vector<std::pair<ClientId, RelocaliseAnswer>> all;
};

TEST(Relocaliser, LooksAtEachClientsLatestViewOnly) {
  World world({cluttered(1)});
  const MapWriter writer(world.map);
  Answers answers;
  Relocaliser relocaliser(writer, world.index, vocabulary());
  const ClientId other{"other", 501}, gone{"gone", 502};
  for (std::uint32_t number = 1; number <= 3; ++number)
    relocaliser.ask(kLost, World::view_of(cluttered(9), number));
  relocaliser.ask(other, World::view_of(world.rooms[0], 8));
  relocaliser.ask(gone, World::view_of(world.rooms[0], 9));
  relocaliser.ask(kLost, World::view_of(world.rooms[0], 4));
  relocaliser.forget(gone);
  relocaliser.start(answers.send());
  ASSERT_EQ(answers.wait_for(2), 2u);
  relocaliser.close();
  ASSERT_EQ(answers.all.size(), 2u);
  EXPECT_EQ(answers.all[0].first, kLost) << "it has asked first";
  EXPECT_EQ(answers.all[0].second.number, 4u);
  EXPECT_TRUE(answers.all[0].second.found);
  EXPECT_EQ(answers.all[1].first, other);
}

TEST(Relocaliser, EndsWithQuestionsWaiting) {
  World world({cluttered(1)});
  const MapWriter writer(world.map);
  Relocaliser relocaliser(writer, world.index, vocabulary());
  relocaliser.ask(kLost, World::view_of(world.rooms[0]));
  relocaliser.close();  // never started
  Answers answers;
  relocaliser.start(answers.send());
  for (std::uint64_t epoch = 600; epoch < 630; ++epoch)
    relocaliser.ask({"many", epoch}, World::view_of(world.rooms[0]));
  relocaliser.close();
}

}  // namespace
}  // namespace cairn
