// Writing the estimate.
#include <algorithm>
#include <limits>

#include <fmt/format.h>

#include "common/util/clock.h"
#include "server/storage/staged.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;
using storage::Blob;
using storage::Pieces;
using storage::StagedRow;
using storage::Table;

StagedRow row_of(Table table, KeyframeId id, Blob data) {
  return {table, id.epoch, id.sequence, std::move(data)};
}
StagedRow row_of(Table table, LandmarkId id, Blob data) {
  return {table, id.origin, id.number, std::move(data)};
}

// Parts that both maps share have one address and need no writing. Gives how many are new or
// changed.
template <typename Key, typename Value>
std::size_t compare(Table table, const CowTable<Key, Value>& saved, const CowTable<Key, Value>& now,
                    std::vector<StagedRow>& rows) {
  const std::size_t first = rows.size();
  now.for_each([&](const Key& key, const Value& value) {
    if (saved.find(key) != &value) rows.push_back(row_of(table, key, storage::encode(value)));
  });
  const std::size_t written = rows.size() - first;
  saved.for_each([&](const Key& key, const Value&) {
    if (!now.contains(key)) rows.push_back(row_of(table, key, {}));
  });
  // In the order of the table, which is faster to write.
  const auto by_id = [](const StagedRow& a, const StagedRow& b) {
    return std::pair(static_cast<std::int64_t>(a.origin), a.number) <
           std::pair(static_cast<std::int64_t>(b.origin), b.number);
  };
  std::sort(rows.begin() + static_cast<std::ptrdiff_t>(first), rows.end(), by_id);
  return written;
}

struct Difference {
  std::vector<StagedRow> rows;
  std::size_t keyframes = 0, landmarks = 0;  // new or changed
  std::vector<KeyframeId> keyframe_ids;      // of the former
};

Difference compare_maps(const Map& saved, const Map& now) {
  Difference d;
  d.keyframes = compare(Table::kNodes, saved.keyframes, now.keyframes, d.rows);
  for (const StagedRow& row : d.rows)
    if (!row.data.empty())
      d.keyframe_ids.push_back({row.origin, static_cast<std::uint32_t>(row.number)});
  d.landmarks = compare(Table::kLandmarks, saved.landmarks, now.landmarks, d.rows);
  compare(Table::kReplacedLandmarks, saved.replaced_landmarks, now.replaced_landmarks, d.rows);
  compare(Table::kRemovedKeyframes, saved.removed_keyframes, now.removed_keyframes, d.rows);
  return d;
}

Status write_header(Database& database, const Map& map) {
  Statement write(database,
                  "INSERT OR REPLACE INTO map(only, id, revision, merge_epoch, keyframes_ever,"
                  " next_landmark) VALUES(1, ?, ?, ?, ?, ?)");
  write.bind(1, map.id.value)
      .bind(2, map.revision)
      .bind(3, map.merge_epoch)
      .bind(4, map.keyframes_ever)
      .bind(5, map.next_landmark);
  return write.run();
}

Status clear_estimate(Database& database) {
  return database.execute(
      "DELETE FROM nodes; DELETE FROM landmarks; DELETE FROM replaced_landmarks;"
      "DELETE FROM removed_keyframes; DELETE FROM mapped_keyframes; DELETE FROM map;"
      "DELETE FROM loops;");
}

Status write_mapped(Database& database, const Map& map) {
  Statement write(database, "INSERT OR REPLACE INTO mapped_keyframes VALUES(?, ?)");
  Status status;
  map.mapped_keyframes.for_each([&](std::uint64_t epoch, std::uint32_t count) {
    write.bind(1, epoch).bind(2, count);
    if (status) status = write.run();
  });
  return status;
}

Status write_loops(Database& database, const Map& map) {
  if (Status status = database.execute("DELETE FROM loops"); !status) return status;
  Statement write(database, "INSERT INTO loops VALUES(?, ?)");
  for (std::size_t i = 0; i < map.loops.size(); ++i) {
    const Blob data = storage::encode(map.loops[i]);
    write.bind(1, std::uint64_t{i + 1}).bind(2, data);
    if (Status status = write.run(); !status) return status;
  }
  return {};
}

// Checkpoints of a map that the file held before, and those of events that are undone.
Status drop_void_checkpoints(Database& database, const Map& map,
                             std::optional<std::size_t> undone) {
  Statement drop(database, "DELETE FROM checkpoints WHERE map <> ? OR event >= ?");
  drop.bind(1, map.id.value)
      .bind(2,
            undone ? static_cast<std::int64_t>(*undone) : std::numeric_limits<std::int64_t>::max());
  return drop.run();
}

// What was mapped and is not there any more has been culled, though the map may have forgotten it.
// Checkpoints may still need it. Looks at the next few that arrived from `first` on, as blobs are
// large; gives the last of them, 0 for none.
Result<std::int64_t> drop_some_culled(Database& database, std::int64_t first,
                                      std::size_t& dropped) {
  constexpr int kKeyframes = 50;
  auto last = database.query_integer(
      fmt::format("SELECT max(arrival) FROM (SELECT arrival FROM keyframes WHERE arrival >= {}"
                  " ORDER BY arrival LIMIT {})",
                  first, kKeyframes));
  if (!last) return last.error();
  Status status = database.execute(fmt::format(
      "DELETE FROM keyframes WHERE arrival BETWEEN {} AND {} AND"
      " NOT EXISTS (SELECT 1 FROM nodes WHERE origin = epoch AND number = sequence) AND"
      " NOT EXISTS (SELECT 1 FROM copied_keyframes c"
      "  WHERE c.epoch = keyframes.epoch AND c.sequence = keyframes.sequence) AND"
      " (EXISTS (SELECT 1 FROM removed_keyframes WHERE origin = epoch AND number = sequence) OR"
      "  sequence < (SELECT count FROM mapped_keyframes m WHERE m.epoch = keyframes.epoch))",
      first, *last));
  if (!status) return status.error();
  const auto changes = database.query_integer("SELECT changes()");
  if (!changes) return changes.error();
  dropped += static_cast<std::size_t>(*changes);
  return last;
}

Status drop_culled_blobs(Pieces& pieces, std::size_t& dropped) {
  std::int64_t newest = 0, last = 0;  // what arrives from now on is not looked at
  do {
    Status status = pieces.one([&](Database& database) -> Status {
      const auto now = database.query_integer("SELECT max(arrival) FROM keyframes");
      if (!now) return now.error();
      if (last == 0) newest = *now;
      const auto seen = drop_some_culled(database, last + 1, dropped);
      if (!seen) return seen.error();
      last = *seen;
      return {};
    });
    if (!status) return status;
  } while (last > 0 && last < newest);
  return {};
}

// The blob of a keyframe that the journal does not have; nothing when it has it.
Result<wire::Blob> missing_blob(Database& database, const Keyframe& keyframe) {
  Statement find(database, "SELECT 1 FROM keyframes WHERE epoch = ? AND sequence = ?");
  find.bind(1, keyframe.id.epoch).bind(2, keyframe.id.sequence);
  const Result<bool> stored = find.step();
  if (!stored) return stored.error();
  if (*stored) return wire::Blob();
  Statement name(database, "SELECT name FROM clients WHERE epoch = ?");
  name.bind(1, keyframe.id.epoch);
  const Result<bool> known = name.step();
  if (!known) return known.error();
  return wire::encode_keyframe(*known ? name.text(0) : "unknown", keyframe);
}

}  // namespace

Status storage::store_missing_blobs(MapFile::Parts& parts, Pieces& pieces,
                                    const std::vector<KeyframeId>& ids, const Map& map) {
  return pieces.rows(
      ids.size(), [&](Database& database, std::size_t i, Room& room) -> Result<std::size_t> {
        for (; i < ids.size() && room.left(); ++i) {
          const auto blob = missing_blob(database, *map.keyframes.at(ids[i]).keyframe);
          if (!blob) return blob.error();
          room.take(blob->size());
          if (blob->empty()) continue;
          parts.insert_keyframe->bind(1, ids[i].epoch).bind(2, ids[i].sequence).bind(3, *blob);
          if (Status status = parts.insert_keyframe->run(); !status) return status.error();
        }
        return i;
      });
}

Result<SaveSummary> MapFile::save_map(const Map& map) {
  Parts& p = *parts_;
  if (p.mode == Mode::kReadOnly) return storage::refuse_writing().error();
  if (p.in_memory) return SaveSummary{};
  const std::lock_guard saving(p.save_mutex);
  return replace_map(map, std::nullopt);
}

Result<SaveSummary> MapFile::replace_map(const Map& map, std::optional<std::size_t> undone) {
  Parts& p = *parts_;
  const Stopwatch watch;
  const bool from_scratch = !p.saved;
  const Difference difference = compare_maps(from_scratch ? Map{} : *p.saved, map);
  SaveSummary summary{.keyframes = difference.keyframes, .landmarks = difference.landmarks};

  Pieces pieces(p);
  Status status = storage::finish_staged(pieces);  // of a save that failed
  if (status) status = storage::store_missing_blobs(p, pieces, difference.keyframe_ids, map);
  if (status) status = storage::stage(pieces, difference.rows);
  if (status)
    status = pieces.one([&](Database& database) -> Status {
      Status s = from_scratch ? clear_estimate(database) : Status();
      if (s) s = write_header(database, map);
      if (s) s = storage::accept_staged(database);
      if (s) s = write_loops(database, map);
      if (s) s = write_mapped(database, map);
      if (s) s = drop_void_checkpoints(database, map, undone);
      return s;
    });
  if (!status) return status.error();
  p.saved = map;
  status = storage::finish_staged(pieces);
  if (status) status = storage::drop_loose_copies(pieces);
  if (status) status = drop_culled_blobs(pieces, summary.dropped_blobs);
  if (!status) return status.error();
  summary.milliseconds = watch.milliseconds();
  summary.writing = pieces.times();
  return summary;
}

}  // namespace cairn
