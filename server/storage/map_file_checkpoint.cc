// Checkpoints: the map as it was before a loop or a merge.
#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/util/clock.h"
#include "server/storage/checkpoint_codec.h"
#include "server/storage/map_file_parts.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;

// The number stays free: what was kept for the same event or for later ones, before the server was
// killed and found its loops anew, is of another course of things.
Status drop_checkpoints(Database& database, std::size_t event, std::size_t keep) {
  Statement drop(database, "DELETE FROM checkpoints WHERE event >= ?1 OR event <= ?1 - ?2");
  drop.bind(1, std::uint64_t{event}).bind(2, std::uint64_t{std::min(keep, event)});
  return drop.run();
}

Status write_checkpoint(Database& database, std::size_t event, const Map& before,
                        const std::vector<KeyframeId>& keyframes, const storage::Blob& data) {
  Statement write(database, "INSERT INTO checkpoints VALUES(?, ?, ?)");
  write.bind(1, std::uint64_t{event}).bind(2, before.id.value).bind(3, data);
  if (Status status = write.run(); !status) return status;
  Statement need(database, "INSERT INTO checkpoint_keyframes VALUES(?, ?, ?)");
  for (const KeyframeId id : keyframes) {
    need.bind(1, id.epoch).bind(2, id.sequence).bind(3, std::uint64_t{event});
    if (Status status = need.run(); !status) return status;
  }
  return {};
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

Result<CheckpointSummary> MapFile::save_checkpoint(const Map& before, std::size_t keep) {
  Parts& p = *parts_;
  if (p.mode == Mode::kReadOnly) return storage::refuse_writing().error();
  CheckpointSummary summary{.event = before.loops.size() + 1};
  if (p.in_memory) return summary;
  const Stopwatch watch;
  const storage::Blob data = keep > 0 ? storage::encode_checkpoint(before) : storage::Blob();
  const std::vector<KeyframeId> keyframes = before.keyframes.sorted_keys();
  summary.bytes = data.size();

  const std::lock_guard lock(p.mutex);
  const Stopwatch locked;
  sqlite::Transaction transaction(p.database);
  Status status = transaction.begin();
  if (status) status = drop_checkpoints(p.database, summary.event, keep);
  if (status && keep > 0) {
    status = write_checkpoint(p.database, summary.event, before, keyframes, data);
    if (status) status = storage::store_missing_blobs(p, keyframes, before);
  }
  if (status) status = transaction.commit();
  if (!status) return status.error();
  summary.locked_ms = locked.milliseconds();
  summary.milliseconds = watch.milliseconds();
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
  Statement find(p.database, "SELECT data FROM checkpoints WHERE event = ?");
  find.bind(1, std::uint64_t{event});
  const Result<bool> found = find.step();
  if (!found) return found.error();
  if (!*found) return not_kept(p.database, event);

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
  return storage::decode_checkpoint(find.blob(0), load);
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
