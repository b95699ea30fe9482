// Reading the estimate back.
#include <unordered_map>

#include <fmt/format.h>

#include "common/util/parallel.h"
#include "server/storage/map_codec.h"
#include "server/storage/map_connect.h"
#include "server/storage/map_file_parts.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;
using storage::corrupt;

KeyframeId keyframe_at(const Statement& row) {
  return {row.unsigned_integer(0), static_cast<std::uint32_t>(row.integer(1))};
}
LandmarkId landmark_at(const Statement& row) {
  return {row.unsigned_integer(0), row.unsigned_integer(1)};
}

// Calls `read(statement)` for each row until it returns an error.
template <typename Read>
Status for_each_row(Database& database, std::string_view sql, Read&& read) {
  Statement statement(database, sql);
  Result<bool> row = statement.step();
  for (; row && *row; row = statement.step())
    if (Status status = read(statement); !status) return status;
  return row ? Status{} : Status(row.error());
}

// A row of a keyframe, before it is made sense of.
struct KeyframeRow {
  KeyframeId id;
  wire::Blob estimate, measurement;
};

Result<KeyframeNode> decode(const KeyframeRow& row) {
  KeyframeNode node;
  const auto decoded = storage::decode_keyframe(row.measurement, row.id);
  if (!decoded) return decoded.error();
  node.keyframe = decoded->keyframe;
  if (!storage::decode(row.estimate, node)) return corrupt("a pose is unreadable");
  return node;
}

Status insert_all(const std::vector<KeyframeRow>& rows, Map& map) {
  std::vector<Result<KeyframeNode>> nodes(rows.size(), corrupt("a keyframe was not read"));
  for_each_index(rows.size(), [&](std::size_t i) { nodes[i] = decode(rows[i]); });
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!nodes[i]) return nodes[i].error();
    map.keyframes.insert(rows[i].id, std::move(*nodes[i]));
  }
  return {};
}

// Unpacking descriptors is most of what loading costs, and needs no order: on all processors, some
// megabytes at a time.
Status load_keyframes(Database& database, Map& map) {
  constexpr std::size_t kTogether = 256;
  std::vector<KeyframeRow> rows;
  const Status read = for_each_row(database,
                                   "SELECT origin, number, data, blob FROM nodes"
                                   " LEFT JOIN keyframes ON epoch = origin AND sequence = number",
                                   [&](const Statement& row) -> Status {
                                     const wire::Bytes estimate = row.blob(2),
                                                       measurement = row.blob(3);
                                     rows.push_back({keyframe_at(row),
                                                     {estimate.begin(), estimate.end()},
                                                     {measurement.begin(), measurement.end()}});
                                     if (rows.size() < kTogether) return {};
                                     const Status inserted = insert_all(rows, map);
                                     rows.clear();
                                     return inserted;
                                   });
  return read ? insert_all(rows, map) : read;
}

Status load_landmarks(Database& database, Map& map) {
  return for_each_row(database, "SELECT origin, number, data FROM landmarks",
                      [&](const Statement& row) -> Status {
                        Landmark landmark;
                        landmark.id = landmark_at(row);
                        if (!storage::decode(row.blob(2), landmark))
                          return corrupt("a landmark is unreadable");
                        const LandmarkId id = landmark.id;
                        map.landmarks.insert(id, std::move(landmark));
                        return {};
                      });
}

Status load_history(Database& database, Map& map) {
  Status status = for_each_row(database, "SELECT origin, number, data FROM replaced_landmarks",
                               [&](const Statement& row) -> Status {
                                 FormerLandmark former;
                                 if (!storage::decode(row.blob(2), former))
                                   return corrupt("a replaced landmark is unreadable");
                                 map.replaced_landmarks.insert(landmark_at(row), former);
                                 return {};
                               });
  if (!status) return status;
  return for_each_row(database, "SELECT origin, number, data FROM removed_keyframes",
                      [&](const Statement& row) -> Status {
                        FormerKeyframe former;
                        if (!storage::decode(row.blob(2), former))
                          return corrupt("a culled keyframe is unreadable");
                        map.removed_keyframes.insert(keyframe_at(row), former);
                        return {};
                      });
}

Status load_mapped(Database& database, Map& map) {
  return for_each_row(database, "SELECT epoch, count FROM mapped_keyframes",
                      [&](const Statement& row) -> Status {
                        map.mapped_keyframes.insert(row.unsigned_integer(0),
                                                    static_cast<std::uint32_t>(row.integer(1)));
                        return {};
                      });
}

Status load_loops(Database& database, Map& map) {
  return for_each_row(database, "SELECT data FROM loops ORDER BY event",
                      [&](const Statement& row) -> Status {
                        if (!storage::decode(row.blob(0), map.loops.emplace_back()))
                          return corrupt("a closed loop is unreadable");
                        return {};
                      });
}

Result<bool> load_header(Database& database, Map& map) {
  Statement row(database,
                "SELECT id, revision, merge_epoch, keyframes_ever, next_landmark FROM map");
  Result<bool> found = row.step();
  if (!found || !*found) return found;
  map.id.value = row.unsigned_integer(0);
  map.revision = row.unsigned_integer(1);
  map.merge_epoch = static_cast<std::uint32_t>(row.integer(2));
  map.keyframes_ever = row.unsigned_integer(3);
  map.next_landmark = row.unsigned_integer(4);
  return true;
}

}  // namespace

Error storage::corrupt(const std::string& what) {
  return {ErrorCode::kCorrupt,
          "the map file is damaged: " + what + "; restore a copy or name another file"};
}

Result<wire::DecodedKeyframe> storage::decode_keyframe(Bytes blob, KeyframeId id) {
  auto decoded = wire::decode_keyframe(blob);
  if (!decoded || decoded->keyframe->id != id)
    return corrupt(fmt::format("keyframe {:x}:{} is unreadable{}{}", id.epoch, id.sequence,
                               decoded ? "" : ", ", decoded ? "" : decoded.message()));
  return decoded;
}

Result<std::optional<Map>> MapFile::load_map() {
  Parts& p = *parts_;
  if (p.in_memory) return std::optional<Map>();
  const std::lock_guard saving(p.save_mutex);
  const std::lock_guard lock(p.mutex);
  Map map;
  const Result<bool> found = load_header(p.database, map);
  if (!found) return found.error();
  if (!*found) return std::optional<Map>();
  Status status = load_keyframes(p.database, map);
  if (status) status = load_landmarks(p.database, map);
  if (status) status = load_history(p.database, map);
  if (status) status = load_loops(p.database, map);
  if (status) status = load_mapped(p.database, map);
  if (status) status = storage::connect(map);
  if (!status) return status.error();
  p.saved = map;
  return std::optional<Map>(std::move(map));
}

Result<std::vector<wire::DecodedKeyframe>> MapFile::pending_keyframes() {
  Parts& p = *parts_;
  std::vector<wire::DecodedKeyframe> pending;
  if (p.in_memory) return pending;
  const std::lock_guard saving(p.save_mutex);  // not while rows are on their way
  const std::lock_guard lock(p.mutex);
  const Status status = for_each_row(
      p.database,
      "SELECT epoch, sequence, blob FROM keyframes k WHERE"
      " NOT EXISTS (SELECT 1 FROM nodes WHERE origin = k.epoch AND number = k.sequence) AND"
      " NOT EXISTS (SELECT 1 FROM removed_keyframes WHERE origin = k.epoch AND number = k.sequence)"
      " AND sequence >= ifnull((SELECT count FROM mapped_keyframes m WHERE m.epoch = k.epoch), 0)"
      " ORDER BY arrival",
      [&](const Statement& row) -> Status {
        auto decoded = storage::decode_keyframe(row.blob(2), keyframe_at(row));
        if (!decoded) return decoded.error();
        pending.push_back(std::move(*decoded));
        return {};
      });
  if (!status) return status.error();
  return pending;
}

}  // namespace cairn
