#include "server/storage/map_file.h"

#include <csignal>
#include <fstream>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/map/apply.h"
#include "server/map/invariants.h"
#include "server/storage/sqlite.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

const ClientId kClient{"walker", 7};

// A folder of its own for each test, gone afterwards.
class MapFileTest : public testing::Test {
 protected:
  MapFileTest()
      : folder_(fs::temp_directory_path() / ("cairn_map_file_test_" + std::to_string(getpid()))),
        path_(folder_ / "map.db") {
    fs::create_directories(folder_);
  }
  ~MapFileTest() override { fs::remove_all(folder_); }

  std::unique_ptr<MapFile> open(MapFile::Mode mode = MapFile::Mode::kReadWrite) {
    auto file = MapFile::open(path_, mode);
    EXPECT_TRUE(file.ok()) << file.message();
    return std::move(*file);
  }
  ErrorCode code_of_open() {
    const auto file = MapFile::open(path_);
    EXPECT_FALSE(file.ok());
    if (file.ok()) return ErrorCode::kInternal;
    EXPECT_EQ(file.message().find('\n'), std::string::npos);
    EXPECT_NE(file.message().find("map.db"), std::string::npos);
    return file.error().code;
  }
  void write_file(const std::string& bytes) { std::ofstream(path_, std::ios::binary) << bytes; }
  std::string read_file() {
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const fs::path folder_, path_;
};

// What goes through the wire, as ingest would hand it on.
struct Sent {
  explicit Sent(const SyntheticMap& world) {
    for (const KeyframePtr& keyframe : world.keyframes) {
      blobs.push_back(*wire::encode_keyframe(kClient.name, *keyframe));
      keyframes.push_back(wire::decode_keyframe(blobs.back())->keyframe);
    }
  }
  void append(MapFile& file, std::size_t first, std::size_t last) const {
    for (std::size_t i = first; i < last; ++i) {
      const Status status = file.append(kClient, keyframes[i]->id, blobs[i]);
      ASSERT_TRUE(status.ok()) << status.message();
    }
  }
  std::vector<wire::Blob> blobs;
  std::vector<KeyframePtr> keyframes;
};

const SyntheticMap& small_world() {
  static const SyntheticMap world({.keyframes = 6, .points = 150});
  return world;
}

Map map_of(const Sent& sent, std::size_t count) {
  Map map;
  map.id = {42};
  for (std::size_t i = 0; i < count; ++i) apply_keyframe(map, sent.keyframes[i]);
  return map;
}

void expect_same_node(const KeyframeNode& a, const KeyframeNode& b) {
  EXPECT_EQ(a.map_from_camera.matrix(), b.map_from_camera.matrix());
  EXPECT_EQ(a.landmarks, b.landmarks);
  EXPECT_EQ(a.parent, b.parent);
  EXPECT_EQ(a.children, b.children);
  EXPECT_EQ(a.arrival, b.arrival);
  EXPECT_EQ(a.revision, b.revision);
  ASSERT_EQ(a.covisible.size(), b.covisible.size());
  for (std::size_t i = 0; i < a.covisible.size(); ++i) {
    EXPECT_EQ(a.covisible[i].keyframe, b.covisible[i].keyframe);
    EXPECT_EQ(a.covisible[i].shared, b.covisible[i].shared);
  }
  EXPECT_EQ(a.keyframe->stamp_ns, b.keyframe->stamp_ns);
  EXPECT_EQ(a.rig(), b.rig());
  ASSERT_EQ(a.features().size(), b.features().size());
  EXPECT_EQ(a.features().descriptors, b.features().descriptors);
}

void expect_same_landmark(const Landmark& a, const Landmark& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.observations, b.observations);
  EXPECT_EQ(a.reference, b.reference);
  EXPECT_EQ(a.descriptor, b.descriptor);
  EXPECT_EQ(a.normal, b.normal);
  EXPECT_EQ(a.min_distance, b.min_distance);
  EXPECT_EQ(a.max_distance, b.max_distance);
  EXPECT_EQ(std::tuple(a.visible, a.found, a.birth, a.arrival, a.revision),
            std::tuple(b.visible, b.found, b.birth, b.arrival, b.revision));
}

void expect_same_map(const Map& a, const Map& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.merge_epoch, b.merge_epoch);
  EXPECT_EQ(a.keyframes_ever, b.keyframes_ever);
  EXPECT_EQ(a.next_landmark, b.next_landmark);
  ASSERT_EQ(a.keyframes.sorted_keys(), b.keyframes.sorted_keys());
  for (const KeyframeId id : a.keyframes.sorted_keys())
    expect_same_node(a.keyframes.at(id), b.keyframes.at(id));
  ASSERT_EQ(a.landmarks.sorted_keys(), b.landmarks.sorted_keys());
  for (const LandmarkId id : a.landmarks.sorted_keys())
    expect_same_landmark(a.landmarks.at(id), b.landmarks.at(id));
  ASSERT_EQ(a.replaced_landmarks.sorted_keys(), b.replaced_landmarks.sorted_keys());
  for (const LandmarkId id : a.replaced_landmarks.sorted_keys())
    EXPECT_EQ(a.replaced_landmarks.at(id).now, b.replaced_landmarks.at(id).now);
  ASSERT_EQ(a.removed_keyframes.sorted_keys(), b.removed_keyframes.sorted_keys());
  for (const KeyframeId id : a.removed_keyframes.sorted_keys())
    EXPECT_EQ(a.removed_keyframes.at(id).anchor, b.removed_keyframes.at(id).anchor);
  ASSERT_EQ(a.mapped_keyframes.sorted_keys(), b.mapped_keyframes.sorted_keys());
  for (const std::uint64_t epoch : a.mapped_keyframes.sorted_keys())
    EXPECT_EQ(a.mapped_of(epoch), b.mapped_of(epoch));
}

Map load(MapFile& file) {
  auto map = file.load_map();
  EXPECT_TRUE(map.ok()) << map.message();
  EXPECT_TRUE(map->has_value());
  return std::move(**map);
}

SaveSummary save(MapFile& file, const Map& map) {
  const auto summary = file.save_map(map);
  EXPECT_TRUE(summary.ok()) << summary.message();
  return *summary;
}

std::size_t pending_count(MapFile& file) {
  const auto pending = file.pending_keyframes();
  EXPECT_TRUE(pending.ok()) << pending.message();
  return pending->size();
}

// Two landmarks fused and a keyframe culled, so that every table has rows.
void rework(Map& map) {
  const auto landmarks = map.landmarks.sorted_keys();
  MapDelta delta;
  delta.base_revision = map.revision;
  delta.removed_landmarks = {landmarks[0]};
  delta.positions = {{landmarks[4], {1, 2, 3}}};
  apply_delta(map, delta);
  map.replaced_landmarks.insert(landmarks[0], {landmarks[1], map.keyframes_ever});
  map.mapped_keyframes.insert(kClient.epoch, 4);
  ASSERT_TRUE(remove_keyframe(map, {kClient.epoch, 2}));
}

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
