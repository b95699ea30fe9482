// Writing the estimate.
#include <algorithm>
#include <limits>
#include <unordered_map>

#include "common/util/clock.h"
#include "server/storage/map_codec.h"
#include "server/storage/map_file_parts.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;
using storage::Blob;

// Every table of the estimate has the same three columns.
struct Row {
  std::uint64_t origin, number;
  Blob data;
};
Row row_of(KeyframeId id, Blob data) {
  return {id.epoch, id.sequence, std::move(data)};
}
Row row_of(LandmarkId id, Blob data) {
  return {id.origin, id.number, std::move(data)};
}

struct Changes {
  std::vector<Row> written, erased;
};

// Parts that both maps share have one address and need no writing.
template <typename Key, typename Value>
Changes compare(const CowTable<Key, Value>& saved, const CowTable<Key, Value>& now) {
  Changes changes;
  now.for_each([&](const Key& key, const Value& value) {
    if (saved.find(key) != &value) changes.written.push_back(row_of(key, storage::encode(value)));
  });
  saved.for_each([&](const Key& key, const Value&) {
    if (!now.contains(key)) changes.erased.push_back(row_of(key, {}));
  });
  // In the order of the table, which is faster to write.
  const auto by_id = [](const Row& a, const Row& b) {
    return std::pair(static_cast<std::int64_t>(a.origin), a.number) <
           std::pair(static_cast<std::int64_t>(b.origin), b.number);
  };
  std::sort(changes.written.begin(), changes.written.end(), by_id);
  return changes;
}

struct Difference {
  Changes nodes, landmarks, replaced, removed;
};

Difference compare_maps(const Map& saved, const Map& now) {
  return {compare(saved.keyframes, now.keyframes), compare(saved.landmarks, now.landmarks),
          compare(saved.replaced_landmarks, now.replaced_landmarks),
          compare(saved.removed_keyframes, now.removed_keyframes)};
}

Status write_changes(Database& database, const std::string& table, const Changes& changes) {
  Statement write(database, "INSERT OR REPLACE INTO " + table + " VALUES(?, ?, ?)");
  for (const Row& row : changes.written) {
    write.bind(1, row.origin).bind(2, row.number).bind(3, row.data);
    if (Status status = write.run(); !status) return status;
  }
  Statement erase(database, "DELETE FROM " + table + " WHERE origin = ? AND number = ?");
  for (const Row& row : changes.erased) {
    erase.bind(1, row.origin).bind(2, row.number);
    if (Status status = erase.run(); !status) return status;
  }
  return {};
}

Status write_header(Database& database, const Map& map) {
  Statement write(database, "INSERT OR REPLACE INTO map VALUES(1, ?, ?, ?, ?, ?)");
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
// Checkpoints may still need it.
Status drop_culled_blobs(Database& database, std::size_t& dropped) {
  if (Status status = database.execute(
          "DELETE FROM keyframes WHERE"
          " NOT EXISTS (SELECT 1 FROM nodes WHERE origin = epoch AND number = sequence) AND"
          " NOT EXISTS (SELECT 1 FROM checkpoint_keyframes c"
          "  WHERE c.epoch = keyframes.epoch AND c.sequence = keyframes.sequence) AND"
          " (EXISTS (SELECT 1 FROM removed_keyframes WHERE origin = epoch AND number = sequence) OR"
          "  sequence < (SELECT count FROM mapped_keyframes m WHERE m.epoch = keyframes.epoch))");
      !status)
    return status;
  const auto changes = database.query_integer("SELECT changes()");
  if (!changes) return changes.error();
  dropped = static_cast<std::size_t>(*changes);
  return {};
}

}  // namespace

Status storage::store_missing_blobs(MapFile::Parts& parts, const std::vector<KeyframeId>& ids,
                                    const Map& map) {
  Statement find(parts.database, "SELECT 1 FROM keyframes WHERE epoch = ? AND sequence = ?");
  Statement name(parts.database, "SELECT name FROM clients WHERE epoch = ?");
  for (const KeyframeId id : ids) {
    find.bind(1, id.epoch).bind(2, id.sequence);
    const Result<bool> stored = find.step();
    if (!stored) return stored.error();
    find.reset();
    if (*stored) continue;
    name.bind(1, id.epoch);
    const Result<bool> known = name.step();
    if (!known) return known.error();
    const std::string client = *known ? name.text(0) : "unknown";
    name.reset();
    const auto blob = wire::encode_keyframe(client, *map.keyframes.at(id).keyframe);
    if (!blob) return blob.error();
    parts.insert_keyframe->bind(1, id.epoch).bind(2, id.sequence).bind(3, *blob);
    if (Status status = parts.insert_keyframe->run(); !status) return status;
  }
  return {};
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
  SaveSummary summary{.keyframes = difference.nodes.written.size(),
                      .landmarks = difference.landmarks.written.size()};
  std::vector<KeyframeId> written;
  for (const Row& row : difference.nodes.written)
    written.push_back({row.origin, static_cast<std::uint32_t>(row.number)});

  const std::lock_guard lock(p.mutex);
  const Stopwatch locked;
  sqlite::Transaction transaction(p.database);
  Status status = transaction.begin();
  if (status && from_scratch) status = clear_estimate(p.database);
  if (status) status = write_header(p.database, map);
  if (status) status = write_changes(p.database, "nodes", difference.nodes);
  if (status) status = write_changes(p.database, "landmarks", difference.landmarks);
  if (status) status = write_changes(p.database, "replaced_landmarks", difference.replaced);
  if (status) status = write_changes(p.database, "removed_keyframes", difference.removed);
  if (status) status = storage::store_missing_blobs(p, written, map);
  if (status) status = write_loops(p.database, map);
  if (status) status = write_mapped(p.database, map);
  if (status) status = drop_void_checkpoints(p.database, map, undone);
  if (status) status = drop_culled_blobs(p.database, summary.dropped_blobs);
  if (status) status = transaction.commit();
  if (!status) return status.error();
  p.saved = map;
  summary.locked_ms = locked.milliseconds();
  summary.milliseconds = watch.milliseconds();
  return summary;
}

}  // namespace cairn
