#include "server/storage/map_file.h"

#include <csignal>

#include <sys/wait.h>

#include "server/map/invariants.h"
#include "server/storage/sqlite.h"
#include "tests/unit/server/storage/map_file_fixture.h"

namespace cairn {
namespace {

TEST_F(MapFileTest, NewFileHoldsNoMap) {
  const auto file = open();
  const auto map = file->load_map();
  ASSERT_TRUE(map.ok());
  EXPECT_FALSE(map->has_value());
  EXPECT_EQ(pending_count(*file), 0u);
  EXPECT_EQ(file->next_sequence(kClient), 0u);
}

TEST_F(MapFileTest, LoadedMapEqualsTheSavedOne) {
  const Sent sent(small_world());
  Map map = map_of(sent, 6);
  rework(map);
  {
    const auto file = open();
    sent.append(*file, 0, 6);
    save(*file, map);
    expect_same_map(load(*file), map);
  }
  const auto file = open();
  const Map loaded = load(*file);
  expect_same_map(loaded, map);
  EXPECT_TRUE(check_invariants(loaded).empty()) << check_invariants(loaded).front();
}

TEST_F(MapFileTest, LoopsAndMergesAreKept) {
  const Sent sent(small_world());
  Map map = map_of(sent, 6);
  LoopEdge edge;
  edge.query = {7, 5};
  edge.candidate = {7, 0};
  edge.candidate_from_query = {so3_exp({0.1, 0.2, 0.3}), {1, 2, 3}, 1.5};
  edge.inliers = 300;
  map.loops.push_back(edge);
  edge.merges = true;
  edge.new_map_from_old_map = {so3_exp({0, 0.2, -0.3}), {-1, 2, -3}, 0.25};
  edge.moved = {3, ~std::uint64_t{0}};
  map.loops.push_back(edge);
  map.merge_epoch = 2;
  save(*open(), map);
  expect_same_map(load(*open()), map);
}

TEST_F(MapFileTest, AnUnreadableLoopIsRefused) {
  const Sent sent(small_world());
  Map map = map_of(sent, 2);
  LoopEdge edge;
  edge.query = {7, 1};
  edge.candidate = {7, 0};
  edge.candidate_from_query.scale = -1;
  map.loops.push_back(edge);
  const auto file = open();
  save(*file, map);
  const auto loaded = file->load_map();
  ASSERT_FALSE(loaded.ok());
  EXPECT_EQ(loaded.error().code, ErrorCode::kCorrupt);
}

TEST_F(MapFileTest, SecondSaveWritesOnlyWhatChanged) {
  const Sent sent(small_world());
  Map map = map_of(sent, 6);
  const auto file = open();
  sent.append(*file, 0, 6);
  EXPECT_EQ(save(*file, map).landmarks, map.landmarks.size());
  const Map before = map;  // keeps sharing its parts
  MapDelta delta;
  delta.base_revision = map.revision;
  delta.positions = {{map.landmarks.sorted_keys()[3], {1, 2, 3}}};
  apply_delta(map, delta);
  const SaveSummary second = save(*file, map);
  EXPECT_EQ(second.landmarks, 1u);
  EXPECT_EQ(second.keyframes, 0u);
  expect_same_map(load(*file), map);
  rework(map);
  save(*file, map);
  expect_same_map(load(*file), map);
}

TEST_F(MapFileTest, SaveReplacesAMapThatWasNeverLoaded) {
  const Sent sent(small_world());
  {
    const auto file = open();
    save(*file, map_of(sent, 6));
  }
  const auto file = open();
  const Map other = map_of(sent, 3);
  save(*file, other);
  expect_same_map(load(*file), other);
}

TEST_F(MapFileTest, SavesKeyframesThatNeverCameThroughTheJournal) {
  const Sent sent(small_world());
  const Map map = map_of(sent, 4);
  save(*open(), map);
  expect_same_map(load(*open(MapFile::Mode::kReadOnly)), map);
}

TEST_F(MapFileTest, ReportsJournaledKeyframesThatTheSavedMapLacksInOrder) {
  const Sent sent(small_world());
  {
    const auto file = open();
    sent.append(*file, 0, 6);
    save(*file, map_of(sent, 3));
  }
  const auto file = open();
  const auto pending = file->pending_keyframes();
  ASSERT_TRUE(pending.ok());
  ASSERT_EQ(pending->size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ((*pending)[i].client, kClient);
    EXPECT_EQ((*pending)[i].keyframe->id, sent.keyframes[3 + i]->id);
  }
}

TEST_F(MapFileTest, CountsSequencesForEachRunAndSurvivesRepeats) {
  const Sent sent(small_world());
  const auto file = open();
  sent.append(*file, 0, 3);
  sent.append(*file, 1, 2);
  EXPECT_EQ(file->next_sequence(kClient), 3u);
  EXPECT_EQ(file->next_sequence({"walker", 8}), 0u);
  EXPECT_EQ(file->next_sequence({"other", 7}), 0u);
  EXPECT_EQ(pending_count(*file), 3u);
  EXPECT_EQ(*file->clients(), std::vector<ClientId>{kClient});
}

TEST_F(MapFileTest, CulledKeyframesLeaveTheJournalButStayCounted) {
  const Sent sent(small_world());
  Map map = map_of(sent, 6);
  rework(map);
  {
    const auto file = open();
    sent.append(*file, 0, 6);
    EXPECT_EQ(save(*file, map).dropped_blobs, 1u);
  }
  const auto file = open();
  load(*file);
  EXPECT_EQ(pending_count(*file), 0u);
  EXPECT_EQ(file->next_sequence(kClient), 6u);
}

TEST_F(MapFileTest, CulledKeyframesThatTheMapHasForgottenDoNotComeBack) {
  const Sent sent(small_world());
  Map map = map_of(sent, 6);
  rework(map);
  map.removed_keyframes.erase({kClient.epoch, 2});
  const auto file = open();
  sent.append(*file, 0, 6);
  EXPECT_EQ(save(*file, map).dropped_blobs, 1u);
  EXPECT_EQ(pending_count(*file), 0u);
  sent.append(*file, 2, 3);  // its acknowledgement was lost, it comes again
  EXPECT_EQ(pending_count(*file), 0u);
}

TEST_F(MapFileTest, TellsWhichSavedKeyframesAwaitMapping) {
  const Sent sent(small_world());
  Map map = map_of(sent, 5);
  map.mapped_keyframes.insert(kClient.epoch, 3);
  {
    const auto file = open();
    sent.append(*file, 0, 6);
    save(*file, map);
  }
  const auto file = open();
  EXPECT_EQ(load(*file).unmapped(), (std::vector<KeyframeId>{{7, 3}, {7, 4}}));
  EXPECT_EQ(pending_count(*file), 1u);
}

TEST_F(MapFileTest, KilledProcessLosesNothingThatWasAppended) {
  const Sent sent(small_world());
  const pid_t child = fork();
  if (child == 0) {
    auto file = MapFile::open(path_);
    for (std::size_t i = 0; i < 4; ++i)
      if (!(*file)->append(kClient, sent.keyframes[i]->id, sent.blobs[i]).ok()) _exit(1);
    if (!(*file)->save_map(map_of(sent, 2)).ok()) _exit(1);
    if (!(*file)->append(kClient, sent.keyframes[4]->id, sent.blobs[4]).ok()) _exit(1);
    raise(SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  const auto file = open();
  EXPECT_EQ(file->next_sequence(kClient), 5u);
  expect_same_map(load(*file), map_of(sent, 2));
  EXPECT_EQ(pending_count(*file), 3u);
}

TEST_F(MapFileTest, InMemoryOnlyCountsSequences) {
  auto file = MapFile::open({});
  ASSERT_TRUE(file.ok());
  const Sent sent(small_world());
  sent.append(**file, 0, 3);
  save(**file, map_of(sent, 3));
  EXPECT_EQ((*file)->next_sequence(kClient), 3u);
  EXPECT_FALSE((*file)->load_map()->has_value());
  EXPECT_EQ(pending_count(**file), 0u);
}

TEST_F(MapFileTest, ReadOnlyFileRefusesChanges) {
  const Sent sent(small_world());
  save(*open(), map_of(sent, 2));
  const auto file = open(MapFile::Mode::kReadOnly);
  EXPECT_FALSE(file->append(kClient, sent.keyframes[0]->id, sent.blobs[0]).ok());
  EXPECT_FALSE(file->save_map(Map{}).ok());
}

TEST_F(MapFileTest, MissingFileIsNotFoundWhenReading) {
  const auto file = MapFile::open(path_, MapFile::Mode::kReadOnly);
  ASSERT_FALSE(file.ok());
  EXPECT_EQ(file.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(fs::exists(path_));
}

TEST_F(MapFileTest, MissingFolderIsUnavailable) {
  const auto file = MapFile::open(folder_ / "nowhere" / "map.db");
  ASSERT_FALSE(file.ok());
  EXPECT_EQ(file.error().code, ErrorCode::kUnavailable);
}

TEST_F(MapFileTest, FolderIsNoMapFile) {
  EXPECT_EQ(MapFile::open(folder_).error().code, ErrorCode::kInvalidArgument);
}

TEST_F(MapFileTest, FileInUseIsUnavailable) {
  const auto file = open();
  EXPECT_EQ(code_of_open(), ErrorCode::kUnavailable);
}

TEST_F(MapFileTest, TextFileIsRefusedAndLeftAlone) {
  const std::string text(5000, 'x');
  write_file(text);
  EXPECT_EQ(code_of_open(), ErrorCode::kCorrupt);
  EXPECT_EQ(read_file(), text);
}

TEST_F(MapFileTest, DatabaseOfAnotherProgramIsRefused) {
  {
    sqlite::Database database;
    ASSERT_TRUE(database.open(path_.string(), sqlite::Database::Mode::kReadWrite).ok());
    ASSERT_TRUE(database.execute("CREATE TABLE recipes(cake TEXT)").ok());
  }
  EXPECT_EQ(code_of_open(), ErrorCode::kCorrupt);
}

TEST_F(MapFileTest, AnotherVersionIsRefused) {
  open();
  {
    sqlite::Database database;
    ASSERT_TRUE(database.open(path_.string(), sqlite::Database::Mode::kReadWrite).ok());
    ASSERT_TRUE(database.execute("PRAGMA user_version = 99").ok());
  }
  EXPECT_EQ(code_of_open(), ErrorCode::kVersion);
}

TEST_F(MapFileTest, DamagedFileGivesAnErrorOrASoundMap) {
  const Sent sent(small_world());
  save(*open(), map_of(sent, 6));
  const std::string good = read_file();
  std::mt19937 random(5);
  int refused = 0;
  for (int trial = 0; trial < 40; ++trial) {
    std::string bad = good;
    if (trial % 4 == 0)
      bad.resize(random() % bad.size());
    else
      for (int i = 0; i < 20; ++i) bad[random() % bad.size()] = static_cast<char>(random());
    write_file(bad);
    const auto file = MapFile::open(path_, MapFile::Mode::kReadOnly);
    const auto map = file.ok() ? (*file)->load_map() : Result<std::optional<Map>>(file.error());
    if (!map.ok()) {
      ++refused;
      EXPECT_EQ(map.message().find('\n'), std::string::npos);
    } else if (map->has_value()) {
      EXPECT_TRUE(check_invariants(**map).empty());
    }
  }
  EXPECT_GT(refused, 20);
}

TEST_F(MapFileTest, LandmarkSeenTwiceByOneKeyframeIsRefused) {
  const Sent sent(small_world());
  Map map = map_of(sent, 2);
  const auto landmarks = map.landmarks.sorted_keys();
  for (std::size_t i = 1; i < landmarks.size(); ++i) map.landmarks.erase(landmarks[i]);
  Landmark& landmark = *map.landmarks.edit(landmarks[0]);
  landmark.observations = {{{7, 0}, 3}, {{7, 0}, 5}};
  landmark.reference = {7, 0};
  const auto file = open();
  save(*file, map);
  const auto loaded = file->load_map();
  ASSERT_FALSE(loaded.ok());
  EXPECT_EQ(loaded.error().code, ErrorCode::kCorrupt);
}

TEST_F(MapFileTest, ParentsInACircleAreRefused) {
  const Sent sent(small_world());
  Map map = map_of(sent, 4);
  map.keyframes.edit({7, 0})->parent = {7, 3};
  const auto file = open();
  save(*file, map);
  const auto loaded = file->load_map();
  ASSERT_FALSE(loaded.ok());
  EXPECT_EQ(loaded.error().code, ErrorCode::kCorrupt);
}

}  // namespace
}  // namespace cairn
