// Going back to before a loop or a merge.
#include <csignal>

#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "server/map/invariants.h"
#include "server/storage/checkpoint_codec.h"
#include "server/storage/sqlite.h"
#include "tests/unit/server/storage/map_file_fixture.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Closes a loop between the map's first and `sequence`-th keyframe, which moves that one and fuses
// two landmarks.
void close_loop(Map& map, std::uint32_t sequence) {
  LoopClosure closure;
  closure.edge.query = {kClient.epoch, sequence};
  closure.edge.candidate = {kClient.epoch, 0};
  closure.edge.inliers = 20;
  closure.correction = MapDelta::based_on(map);
  const Rigid3 old = map.keyframes.at(closure.edge.query).map_from_camera;
  const Rigid3 move(so3_exp({0, 0.1, 0}), {0.3, 0, 0});
  closure.correction.poses.push_back({closure.edge.query, old, move * old});
  const auto landmarks = map.landmarks.sorted_keys();
  closure.correction.fusions.push_back({landmarks[2], landmarks[3]});
  ASSERT_FALSE(apply_loop(map, closure).is_void);
}

CheckpointSummary keep(MapFile& file, const Map& before,
                       std::size_t count = MapFile::kCheckpoints) {
  const auto summary = file.save_checkpoint(before, count);
  EXPECT_TRUE(summary.ok()) << (summary.ok() ? "" : summary.message());
  return *summary;
}

std::size_t blob_count(const std::filesystem::path& path) {
  sqlite::Database database;
  EXPECT_TRUE(database.open(path.string(), sqlite::Database::Mode::kReadOnly).ok());
  return static_cast<std::size_t>(*database.query_integer("SELECT count(*) FROM keyframes"));
}

void expect_one_line(const std::string& message) {
  EXPECT_FALSE(message.empty());
  EXPECT_EQ(message.find('\n'), std::string::npos);
}

class CheckpointTest : public MapFileTest {
 protected:
  // Five keyframes; a loop is closed after the fourth. The file holds the map afterwards and what
  // undoes the loop, and in the journal one keyframe more.
  void save_with_loop() {
    Map map = map_of(sent_, 4);
    rework(map);
    before_ = map;
    const auto file = open();
    sent_.append(*file, 0, 6);
    close_loop(map, 3);
    keep(*file, before_);
    apply_keyframe(map, sent_.keyframes[4]);
    map.mapped_keyframes.insert(kClient.epoch, 5);
    save(*file, map);
    after_ = map;
  }
  // Runs `change` in a process of its own that is killed once it has written `bytes` to a file.
  template <typename Change>
  void kill_in_the_middle(rlim_t bytes, Change&& change) {
    const pid_t child = fork();
    if (child == 0) {
      auto file = MapFile::open(path_);
      const rlimit limit{bytes, bytes};
      const rlimit no_core{0, 0};
      setrlimit(RLIMIT_CORE, &no_core);
      setrlimit(RLIMIT_FSIZE, &limit);
      signal(SIGXFSZ, SIG_DFL);
      change(**file);
      _exit(0);
    }
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status)) << "wrote less than " << bytes << " bytes";
  }

  const Sent sent_{small_world()};
  Map before_, after_;
};

TEST_F(CheckpointTest, GivesTheMapAsItWas) {
  save_with_loop();
  const auto file = open();
  EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
  const auto map = file->load_checkpoint(1);
  ASSERT_TRUE(map.ok()) << map.message();
  expect_same_map(*map, before_);
  EXPECT_THAT(check_invariants(*map), IsEmpty());
  expect_same_map(load(*file), after_);
}

TEST_F(CheckpointTest, UndoneLoopIsGoneAndLaterKeyframesArePending) {
  save_with_loop();
  {
    const auto file = open();
    EXPECT_EQ(pending_count(*file), 1u);
    const Status status = file->restore(1);
    ASSERT_TRUE(status.ok()) << status.message();
    expect_same_map(load(*file), before_);
  }
  const auto file = open();
  expect_same_map(load(*file), before_);
  EXPECT_THAT(*file->checkpoints(), IsEmpty());
  const auto pending = file->pending_keyframes();
  ASSERT_TRUE(pending.ok());
  ASSERT_EQ(pending->size(), 2u);
  EXPECT_EQ((*pending)[0].keyframe->id, sent_.keyframes[4]->id);
  EXPECT_EQ((*pending)[1].keyframe->id, sent_.keyframes[5]->id);
  EXPECT_EQ(file->next_sequence(kClient), 6u);
}

TEST_F(CheckpointTest, SavingGoesOnAfterAnUndo) {
  save_with_loop();
  const auto file = open();
  ASSERT_TRUE(file->restore(1).ok());
  Map map = load(*file);
  apply_keyframe(map, sent_.keyframes[4]);
  close_loop(map, 4);
  save(*file, map);
  expect_same_map(load(*file), map);
}

TEST_F(CheckpointTest, KeyframesCulledSinceAreKeptAsLongAsTheyAreNeeded) {
  save_with_loop();
  Map map = after_;
  ASSERT_TRUE(remove_keyframe(map, {kClient.epoch, 1}));
  {
    const auto file = open();
    load(*file);
    EXPECT_EQ(save(*file, map).dropped_blobs, 0u);
    const auto loaded = file->load_checkpoint(1);
    ASSERT_TRUE(loaded.ok()) << loaded.message();
    expect_same_map(*loaded, before_);
    keep(*file, map, 0);
    EXPECT_EQ(save(*file, map).dropped_blobs, 1u);
  }
  EXPECT_EQ(blob_count(path_), 4u);  // 0, 3, 4 and the pending 5
}

TEST_F(CheckpointTest, BringsBackBlobsThatWereDroppedMeanwhile) {
  const auto file = open();
  sent_.append(*file, 0, 6);
  const Map before = map_of(sent_, 6);
  Map map = before;
  close_loop(map, 5);
  ASSERT_TRUE(remove_keyframe(map, {kClient.epoch, 1}));
  EXPECT_EQ(save(*file, map).dropped_blobs, 1u);
  keep(*file, before);
  const auto loaded = file->load_checkpoint(1);
  ASSERT_TRUE(loaded.ok()) << loaded.message();
  expect_same_map(*loaded, before);
}

TEST_F(CheckpointTest, OnlyTheLatestAreKept) {
  const auto file = open();
  sent_.append(*file, 0, 6);
  Map map = map_of(sent_, 6);
  std::vector<Map> before;
  for (std::uint32_t event = 1; event <= 5; ++event) {
    before.push_back(map);
    EXPECT_EQ(keep(*file, map).event, event);
    close_loop(map, event);
    save(*file, map);
  }
  EXPECT_THAT(*file->checkpoints(), ElementsAre(3, 4, 5));
  const auto dropped = file->load_checkpoint(2);
  ASSERT_FALSE(dropped.ok());
  EXPECT_EQ(dropped.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(dropped.message(), "event 2 cannot be undone; what can be undone: 3, 4, 5");
  ASSERT_TRUE(file->restore(4).ok());
  EXPECT_THAT(*file->checkpoints(), ElementsAre(3));
  expect_same_map(load(*file), before[3]);
}

// Killed after an event was kept and before the map was saved, the server finds other loops.
TEST_F(CheckpointTest, AnotherCourseOfThingsReplacesWhatWasKept) {
  const auto file = open();
  Map first = map_of(sent_, 6), second = first;
  keep(*file, first);
  close_loop(first, 5);
  keep(*file, first);
  apply_keyframe(second, sent_.keyframes[5]);
  close_loop(second, 3);
  save(*file, first);
  EXPECT_THAT(*file->checkpoints(), ElementsAre(1, 2));
  keep(*file, map_of(sent_, 5));
  EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
}

TEST_F(CheckpointTest, CheckpointsOfAnotherMapAreDropped) {
  save_with_loop();
  Map other = after_;
  other.id = {43};
  const auto file = open();
  save(*file, other);
  EXPECT_THAT(*file->checkpoints(), IsEmpty());
}

TEST_F(CheckpointTest, WhatDidNotHappenCannotBeUndone) {
  save_with_loop();
  const auto file = open();
  keep(*file, after_);  // before an event that the saved map does not have
  for (const std::size_t event : {std::size_t{0}, std::size_t{2}, ~std::size_t{0}}) {
    const Status status = file->restore(event);
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, ErrorCode::kNotFound);
    expect_one_line(status.message());
  }
  expect_same_map(load(*file), after_);
}

TEST_F(CheckpointTest, KilledInTheMiddleOfAnUndoTheFileHoldsTheMapAfterIt) {
  save_with_loop();
  for (const rlim_t bytes : {1'000, 8'000, 16'000}) {
    SCOPED_TRACE(bytes);
    kill_in_the_middle(bytes, [](MapFile& file) { (void)file.restore(1); });
    const auto file = open();
    expect_same_map(load(*file), after_);
    EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
  }
  const auto file = open();
  ASSERT_TRUE(file->restore(1).ok());
  expect_same_map(load(*file), before_);
}

TEST_F(CheckpointTest, KilledWhileKeepingAMapTheFileHoldsWhatItHeld) {
  save_with_loop();
  kill_in_the_middle(8'000, [&](MapFile& file) { (void)file.save_checkpoint(after_); });
  const auto file = open();
  EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
  expect_same_map(*file->load_checkpoint(1), before_);
}

TEST_F(CheckpointTest, DamagedOnesAreRefusedAndTheMapStaysAsItIs) {
  save_with_loop();
  const std::vector<std::string> damages = {
      "UPDATE copies SET data = substr(data, 1, length(data) / 2)",
      "UPDATE copies SET data = x''",
      "DELETE FROM copies",
      "UPDATE copies SET data = substr(data, 1, 500) || x'ff' || substr(data, 502)",
      "DELETE FROM keyframes WHERE sequence = 1",
  };
  for (const std::string& damage : damages) {
    SCOPED_TRACE(damage);
    const std::string good = read_file();
    {
      sqlite::Database database;
      ASSERT_TRUE(database.open(path_.string(), sqlite::Database::Mode::kReadWrite).ok());
      ASSERT_TRUE(database.execute(damage).ok());
    }
    {
      const auto file = open();
      const Status status = file->restore(1);
      ASSERT_FALSE(status.ok());
      EXPECT_EQ(status.error().code, ErrorCode::kCorrupt);
      expect_one_line(status.message());
      EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
    }
    write_file(good);
  }
  expect_same_map(load(*open()), after_);
}

TEST_F(CheckpointTest, ReadOnlyAndInMemoryFilesUndoNothing) {
  save_with_loop();
  const auto file = open(MapFile::Mode::kReadOnly);
  EXPECT_TRUE(file->load_checkpoint(1).ok());
  EXPECT_FALSE(file->restore(1).ok());
  EXPECT_FALSE(file->save_checkpoint(after_).ok());
  const auto memory = MapFile::open({});
  EXPECT_TRUE((*memory)->save_checkpoint(after_).ok());
  EXPECT_THAT(*(*memory)->checkpoints(), IsEmpty());
  EXPECT_FALSE((*memory)->restore(1).ok());
}

// Whatever the checksum lets through must still not crash the reader.
TEST(CheckpointCodec, AnyBytesGiveAnErrorOrASoundMap) {
  const Sent sent(small_world());
  Map map = map_of(sent, 4);
  rework(map);
  close_loop(map, 3);
  const storage::Blob good = storage::encode_checkpoint(map);
  const auto load = [&](KeyframeId id) -> Result<KeyframePtr> {
    if (!map.keyframes.contains(id)) return {ErrorCode::kCorrupt, "no such keyframe"};
    return map.keyframes.at(id).keyframe;
  };
  expect_same_map(*storage::decode_checkpoint(good, load), map);
  std::mt19937 random(3);
  for (int trial = 0; trial < 300; ++trial) {
    storage::Blob bad(good.begin(), good.end() - 8);
    for (int i = 0; i < 1 + trial % 3; ++i)
      bad[random() % (trial % 2 ? bad.size() : 700)] = static_cast<std::uint8_t>(random());
    storage::append_checksum(bad);
    const auto decoded = storage::decode_checkpoint(bad, load);
    if (decoded.ok()) {
      EXPECT_THAT(check_invariants(*decoded), IsEmpty());
    }
  }
}

}  // namespace
}  // namespace cairn
