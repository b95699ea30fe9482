// Checkpoints: the map as it was before a loop or a merge.
#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/util/clock.h"
#include "server/storage/checkpoint_codec.h"
#include "server/storage/pieces.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;
using storage::Pieces;
using storage::Room;

// The number stays free: what was kept for the same event or for later ones, before the server was
// killed and found its loops anew, is of another course of things.
Status drop_checkpoints(Database& database, std::size_t event, std::size_t keep) {
  Statement drop(database, "DELETE FROM checkpoints WHERE event >= ?1 OR event <= ?1 - ?2");
  drop.bind(1, std::uint64_t{event}).bind(2, std::uint64_t{std::min(keep, event)});
  return drop.run();
}

// Beside those that are there: means nothing until a checkpoint names it.
Status write_copy(Pieces& pieces, std::int64_t copy, const std::vector<KeyframeId>& keyframes,
                  const storage::Blob& data) {
  Status status = pieces.rows(
      keyframes.size(), [&](Database& database, std::size_t i, Room& room) -> Result<std::size_t> {
        Statement need(database, "INSERT INTO copied_keyframes VALUES(?, ?, ?)");
        for (; i < keyframes.size() && room.left(); ++i) {
          need.bind(1, keyframes[i].epoch).bind(2, keyframes[i].sequence).bind(3, copy);
          if (Status s = need.run(); !s) return s.error();
          room.take(0);
        }
        return i;
      });
  if (!status) return status;
  std::int64_t piece = 0;
  return pieces.rows(
      data.size(), [&](Database& database, std::size_t first, Room& room) -> Result<std::size_t> {
        const auto bytes =
            storage::Bytes(data).subspan(first, std::min(Room::kBytes, data.size() - first));
        Statement write(database, "INSERT INTO copies VALUES(?, ?, ?)");
        write.bind(1, copy).bind(2, piece++).bind(3, bytes);
        if (Status s = write.run(); !s) return s.error();
        room.take(bytes.size());
        return first + bytes.size();
      });
}

Status name_copy(Database& database, std::size_t event, const Map& before, std::int64_t copy) {
  Statement write(database, "INSERT INTO checkpoints VALUES(?, ?, ?)");
  write.bind(1, std::uint64_t{event}).bind(2, before.id.value).bind(3, copy);
  return write.run();
}

Result<storage::Blob> read_copy(Database& database, std::int64_t copy) {
  storage::Blob data;
  Statement read(database, "SELECT data FROM copies WHERE copy = ? ORDER BY piece");
  read.bind(1, copy);
  Result<bool> row = read.step();
  for (; row && *row; row = read.step()) {
    const auto bytes = read.blob(0);
    data.insert(data.end(), bytes.begin(), bytes.end());
  }
  if (!row) return row.error();
  return data;
}

Result<std::vector<std::size_t>> read_events(Database& database) {
  std::vector<std::size_t> events;
  Statement statement(database, "SELECT event FROM checkpoints ORDER BY event");
  Result<bool> row = statement.step();
  for (; row && *row; row = statement.step())
    events.push_back(static_cast<std::size_t>(statement.integer(0)));
  if (!row) return row.error();
  return events;
}

Error not_kept(Database& database, std::size_t event) {
  const auto events = read_events(database);
  if (!events) return events.error();
  const std::string others = events->empty()
                                 ? "nothing can be undone"
                                 : fmt::format("what can be undone: {}", fmt::join(*events, ", "));
  return {ErrorCode::kNotFound, fmt::format("event {} cannot be undone; {}", event, others)};
}

}  // namespace

Status storage::drop_loose_copies(Pieces& pieces) {
  Status status = pieces.repeat(
      "DELETE FROM copies WHERE rowid IN (SELECT rowid FROM copies"
      " WHERE copy NOT IN (SELECT copy FROM checkpoints) LIMIT 1)");
  if (!status) return status;
  return pieces.repeat(
      fmt::format("DELETE FROM copied_keyframes WHERE (epoch, sequence, copy) IN"
                  " (SELECT epoch, sequence, copy FROM copied_keyframes"
                  "  WHERE copy NOT IN (SELECT copy FROM checkpoints) LIMIT {})",
                  Room::kRows));
}

Result<CheckpointSummary> MapFile::save_checkpoint(const Map& before, std::size_t keep) {
  Parts& p = *parts_;
  if (p.mode == Mode::kReadOnly) return storage::refuse_writing().error();
  CheckpointSummary summary{.event = before.loops.size() + 1};
  if (p.in_memory) return summary;
  const Stopwatch watch;
  const storage::Blob data = keep > 0 ? storage::encode_checkpoint(before) : storage::Blob();
  const std::vector<KeyframeId> keyframes =
      keep > 0 ? before.keyframes.sorted_keys() : std::vector<KeyframeId>();
  summary.bytes = data.size();

  // A save would drop the copy while nothing names it.
  const std::lock_guard saving(p.save_mutex);
  Pieces pieces(p);
  std::int64_t copy = 0;
  Status status = storage::drop_loose_copies(pieces);  // of a save that failed
  if (status)
    status = pieces.one([&](Database& database) -> Status {
      const auto last = database.query_integer("SELECT max(copy) FROM checkpoints");
      if (!last) return last.error();
      copy = *last + 1;
      return {};
    });
  if (status) status = write_copy(pieces, copy, keyframes, data);
  if (status) status = storage::store_missing_blobs(p, pieces, keyframes, before);
  if (status)
    status = pieces.one([&](Database& database) -> Status {
      Status s = drop_checkpoints(database, summary.event, keep);
      if (s && keep > 0) s = name_copy(database, summary.event, before, copy);
      return s;
    });
  if (status) status = storage::drop_loose_copies(pieces);
  if (!status) return status.error();
  summary.milliseconds = watch.milliseconds();
  summary.writing = pieces.times();
  return summary;
}

Result<std::vector<std::size_t>> MapFile::checkpoints() {
  Parts& p = *parts_;
  if (p.in_memory) return std::vector<std::size_t>();
  const std::lock_guard lock(p.mutex);
  return read_events(p.database);
}

Result<Map> MapFile::load_checkpoint(std::size_t event) {
  Parts& p = *parts_;
  if (p.in_memory) return {ErrorCode::kNotFound, "a map in memory keeps nothing to go back to"};
  const std::lock_guard lock(p.mutex);
  Statement find(p.database, "SELECT copy FROM checkpoints WHERE event = ?");
  find.bind(1, std::uint64_t{event});
  const Result<bool> found = find.step();
  if (!found) return found.error();
  if (!*found) return not_kept(p.database, event);
  const Result<storage::Blob> data = read_copy(p.database, find.integer(0));
  if (!data) return data.error();

  Statement read(p.database, "SELECT blob FROM keyframes WHERE epoch = ? AND sequence = ?");
  const auto load = [&](KeyframeId id) -> Result<KeyframePtr> {
    read.bind(1, id.epoch).bind(2, id.sequence);
    const Result<bool> row = read.step();
    if (!row) return row.error();
    if (!*row) return storage::corrupt("a keyframe that a checkpoint needs is missing");
    auto decoded = storage::decode_keyframe(read.blob(0), id);
    read.reset();
    if (!decoded) return decoded.error();
    return std::move(decoded->keyframe);
  };
  return storage::decode_checkpoint(*data, load);
}

Status MapFile::restore(std::size_t event) {
  Parts& p = *parts_;
  if (p.mode == Mode::kReadOnly) return storage::refuse_writing();
  if (p.in_memory) return {ErrorCode::kNotFound, "a map in memory keeps nothing to go back to"};
  const std::lock_guard saving(p.save_mutex);
  {
    const std::lock_guard lock(p.mutex);
    const auto loops = p.database.query_integer("SELECT count(*) FROM loops");
    if (!loops) return loops.error();
    if (event == 0 || event > static_cast<std::uint64_t>(*loops))
      return {ErrorCode::kNotFound,
              fmt::format("there is no event {}; the map has {}", event, *loops)};
  }
  const Result<Map> before = load_checkpoint(event);
  if (!before) return before.error();
  p.saved.reset();  // shares nothing with the checkpoint's map: all is written
  const Result<SaveSummary> saved = replace_map(*before, event);
  return saved ? Status() : Status(saved.error());
}

}  // namespace cairn
