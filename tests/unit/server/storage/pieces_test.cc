// Long writes: append() gets in between, and whatever ends them in the middle, the file holds one
// map or the other.
#include "server/storage/pieces.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include "server/map/invariants.h"
#include "tests/unit/server/storage/map_file_fixture.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

// Enough for several pieces.
const Sent& wide_world() {
  static const Sent sent(SyntheticMap({.keyframes = 5, .points = 14000}));
  return sent;
}

// As after a global adjustment: all that the map holds has moved, some of it is gone.
Map moved(const Map& map) {
  Map after = map;
  MapDelta delta = MapDelta::based_on(map);
  const Rigid3 move(so3_exp({0, 0.01, 0}), {0.1, 0, 0});
  for (const KeyframeId id : map.keyframes.sorted_keys()) {
    const Rigid3& old = map.keyframes.at(id).map_from_camera;
    delta.poses.push_back({id, old, move * old});
  }
  const auto landmarks = map.landmarks.sorted_keys();
  for (const LandmarkId id : landmarks)
    delta.positions.push_back({id, move * map.landmarks.at(id).position});
  delta.removed_landmarks.assign(landmarks.begin(), landmarks.begin() + 20);
  delta.fusions.push_back({landmarks[30], landmarks[31]});
  apply_delta(after, delta);
  return after;
}

std::int64_t rows_of(const fs::path& path, const std::string& table) {
  sqlite::Database database;
  EXPECT_TRUE(database.open(path.string(), sqlite::Database::Mode::kReadOnly).ok());
  const auto rows = database.query_integer("SELECT count(*) FROM " + table);
  EXPECT_TRUE(rows.ok()) << rows.message();
  return *rows;
}

class PiecesTest : public MapFileTest {
 protected:
  // A file with the map as it was before, loaded, as a server has it.
  std::unique_ptr<MapFile> file_before() {
    if (!fs::exists(folder_ / "before.db")) {
      save(*open(), before_);
      fs::copy_file(path_, folder_ / "before.db");
    }
    fs::copy_file(folder_ / "before.db", path_, fs::copy_options::overwrite_existing);
    auto file = open();
    load(*file);
    return file;
  }
  // Lets so many pieces through.
  static void stop_after(MapFile& file, std::size_t pieces) {
    file.set_between_pieces([left = pieces]() mutable { return --left > 0; });
  }

  const Sent& sent_ = wide_world();
  const Map before_ = map_of(sent_, 4);
  const Map after_ = moved(before_);
};

void expect_small_pieces(const WriteTimes& times) {
  EXPECT_GT(times.pieces, 5u);
  EXPECT_LE(times.most_rows, storage::Room::kRows);
  EXPECT_LE(times.most_bytes, 2 * storage::Room::kBytes);
}

TEST_F(PiecesTest, KeyframesAreAppendedBetweenThePiecesOfASave) {
  ASSERT_GT(before_.landmarks.size(), 2 * storage::Room::kRows);
  const auto file = file_before();
  std::uint32_t appended = 0;
  file->set_between_pieces([&] {
    const KeyframeId id{kClient.epoch, 100 + appended++};
    return file->append(kClient, id, sent_.blobs[4]).ok();
  });
  const SaveSummary summary = save(*file, after_);
  expect_small_pieces(summary.writing);
  EXPECT_EQ(appended, summary.writing.pieces - 1);
  EXPECT_EQ(file->next_sequence(kClient), 100 + appended);
  expect_same_map(load(*file), after_);
}

TEST_F(PiecesTest, KeyframesAreAppendedBetweenThePiecesOfACheckpoint) {
  const auto file = file_before();
  std::uint32_t appended = 0;
  file->set_between_pieces([&] {
    const KeyframeId id{kClient.epoch, 100 + appended++};
    return file->append(kClient, id, sent_.blobs[4]).ok();
  });
  const auto summary = file->save_checkpoint(before_);
  ASSERT_TRUE(summary.ok()) << summary.message();
  expect_small_pieces(summary->writing);
  EXPECT_EQ(appended, summary->writing.pieces - 1);
  expect_same_map(*file->load_checkpoint(1), before_);
}

TEST_F(PiecesTest, ACopyOfManyPiecesIsReadAsOne) {
  Map map;
  map.id = {42};
  for (const std::uint64_t epoch : {1, 2, 3, 4, 5, 6, 7, 8, 9})
    for (const KeyframePtr& keyframe :
         SyntheticMap({.keyframes = 2, .points = 14000, .epoch = epoch}).keyframes)
      apply_keyframe(map,
                     wire::decode_keyframe(*wire::encode_keyframe("any", *keyframe))->keyframe);
  const auto file = open();
  const auto summary = file->save_checkpoint(map);
  ASSERT_TRUE(summary.ok()) << summary.message();
  ASSERT_GT(summary->bytes, storage::Room::kBytes);
  expect_same_map(*file->load_checkpoint(1), map);
}

TEST_F(PiecesTest, ASaveThatEndsInTheMiddleLeavesOneMapOrTheOther) {
  const std::size_t pieces = save(*file_before(), after_).writing.pieces;
  bool is_new = false;
  for (std::size_t k = 1; k < pieces; ++k) {
    SCOPED_TRACE(k);
    {
      const auto file = file_before();
      stop_after(*file, k);
      EXPECT_FALSE(file->save_map(after_).ok());
    }
    const Map seen = load(*open(MapFile::Mode::kReadOnly));
    const bool was_new = is_new;
    is_new = seen.revision == after_.revision;
    EXPECT_TRUE(is_new || !was_new) << "the new map was there and is gone";
    expect_same_map(seen, is_new ? after_ : before_);
    const auto file = open();
    expect_same_map(load(*file), seen);
    EXPECT_THAT(check_invariants(load(*file)), IsEmpty());
    save(*file, after_);
    expect_same_map(load(*file), after_);
  }
  EXPECT_TRUE(is_new);
}

TEST_F(PiecesTest, NothingIsLeftBesideTheMap) {
  {
    const auto file = file_before();
    stop_after(*file, 5);
    EXPECT_FALSE(file->save_map(after_).ok());
  }
  EXPECT_GT(rows_of(path_, "staged"), 0);
  open();
  EXPECT_EQ(rows_of(path_, "staged"), 0);
  {
    const auto file = open();
    load(*file);
    save(*file, after_);
  }
  EXPECT_EQ(rows_of(path_, "staged"), 0);
}

// The same process goes on after a full disk.
TEST_F(PiecesTest, AFailedSaveIsMadeUpForByTheNext) {
  const std::size_t pieces = save(*file_before(), after_).writing.pieces;
  for (std::size_t k = 2; k < pieces; k += 3) {
    SCOPED_TRACE(k);
    const auto file = file_before();
    stop_after(*file, k);
    EXPECT_FALSE(file->save_map(after_).ok());
    file->set_between_pieces({});
    Map later = after_;
    apply_keyframe(later, sent_.keyframes[4]);
    save(*file, later);
    expect_same_map(load(*file), later);
  }
}

TEST_F(PiecesTest, ACheckpointThatEndsInTheMiddleLeavesThoseBefore) {
  Map second = after_;
  second.loops.emplace_back().query = {kClient.epoch, 3};
  second.loops.back().candidate = {kClient.epoch, 0};
  std::size_t pieces = 0;
  {
    const auto file = file_before();
    ASSERT_TRUE(file->save_checkpoint(before_).ok());
    pieces = file->save_checkpoint(second)->writing.pieces;
  }
  for (std::size_t k = 1; k < pieces; ++k) {
    SCOPED_TRACE(k);
    bool named = false;
    {
      const auto file = file_before();
      ASSERT_TRUE(file->save_checkpoint(before_).ok());
      stop_after(*file, k);
      EXPECT_FALSE(file->save_checkpoint(second).ok());
      named = file->checkpoints()->size() == 2;
    }
    const auto file = open();
    if (named)
      EXPECT_THAT(*file->checkpoints(), ElementsAre(1, 2));
    else
      EXPECT_THAT(*file->checkpoints(), ElementsAre(1));
    expect_same_map(*file->load_checkpoint(1), before_);
    ASSERT_TRUE(file->save_checkpoint(second).ok());
    expect_same_map(*file->load_checkpoint(2), second);
  }
  EXPECT_EQ(rows_of(path_, "copied_keyframes"), 8);
}

// In the median: between the look at the turns and the wait a machine may stall.
TEST(FairMutex, WhoWaitsComesBeforeTheOneWhoHadIt) {
  FairMutex mutex;
  std::atomic<int> turns = 0;
  std::jthread greedy([&](std::stop_token stop) {
    while (!stop.stop_requested()) {
      const std::lock_guard lock(mutex);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      ++turns;
    }
  });
  std::vector<int> before_us;
  for (int i = 0; i < 15; ++i) {
    const int last = turns;
    while (turns == last) std::this_thread::yield();  // it is at it again
    const int first = turns;
    const std::lock_guard lock(mutex);
    before_us.push_back(turns - first);
  }
  std::nth_element(before_us.begin(), before_us.begin() + 7, before_us.end());
  EXPECT_LE(before_us[7], 2);
}

}  // namespace
}  // namespace cairn
