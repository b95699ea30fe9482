// Opening the file, and the journal.
#include "server/storage/map_file.h"

#include <fmt/format.h>

#include "server/storage/map_file_parts.h"
#include "server/storage/staged.h"

namespace cairn {
namespace {

using sqlite::Database;
using sqlite::Statement;

// Stands in the file's header and tells Cairn's files from those of other programs.
constexpr std::int64_t kApplicationId = 0x4361724e;  // "CarN"
// Grows with every change of the tables or of what is in their blobs.
constexpr std::int64_t kSchemaVersion = 6;

constexpr const char* kSchema = R"sql(
  CREATE TABLE clients(name TEXT NOT NULL, epoch INTEGER NOT NULL, next_sequence INTEGER NOT NULL,
                       PRIMARY KEY(name, epoch)) WITHOUT ROWID;
  -- The journal. `arrival` keeps the order.
  CREATE TABLE keyframes(arrival INTEGER PRIMARY KEY, epoch INTEGER NOT NULL,
                         sequence INTEGER NOT NULL, blob BLOB NOT NULL, UNIQUE(epoch, sequence));
  -- The estimate, as of the last save.
  CREATE TABLE map(only INTEGER PRIMARY KEY CHECK(only = 1), id INTEGER NOT NULL,
                   revision INTEGER NOT NULL, merge_epoch INTEGER NOT NULL,
                   keyframes_ever INTEGER NOT NULL, next_landmark INTEGER NOT NULL,
                   staged INTEGER NOT NULL DEFAULT 0);
  CREATE TABLE nodes(origin INTEGER, number INTEGER, data BLOB NOT NULL,
                     PRIMARY KEY(origin, number)) WITHOUT ROWID;
  CREATE TABLE landmarks(origin INTEGER, number INTEGER, data BLOB NOT NULL,
                         PRIMARY KEY(origin, number)) WITHOUT ROWID;
  CREATE TABLE replaced_landmarks(origin INTEGER, number INTEGER, data BLOB NOT NULL,
                                  PRIMARY KEY(origin, number)) WITHOUT ROWID;
  CREATE TABLE removed_keyframes(origin INTEGER, number INTEGER, data BLOB NOT NULL,
                                 PRIMARY KEY(origin, number)) WITHOUT ROWID;
  -- Rows on their way into the four tables before this, see staged.h. No data: the row goes.
  CREATE TABLE staged(piece INTEGER, target INTEGER, origin INTEGER, number INTEGER, data BLOB,
                      PRIMARY KEY(piece, target, origin, number)) WITHOUT ROWID;
  -- Loops closed and parts merged, counted from 1.
  CREATE TABLE loops(event INTEGER PRIMARY KEY, data BLOB NOT NULL);
  -- Keyframes 0 .. count-1 of a client run have been through local mapping.
  CREATE TABLE mapped_keyframes(epoch INTEGER PRIMARY KEY, count INTEGER NOT NULL);
  -- The estimate as it was before an event: which copy of it. A copy that no event names is loose.
  CREATE TABLE checkpoints(event INTEGER PRIMARY KEY, map INTEGER NOT NULL,
                           copy INTEGER NOT NULL UNIQUE);
  CREATE TABLE copies(copy INTEGER, piece INTEGER, data BLOB NOT NULL, PRIMARY KEY(copy, piece));
  -- The keyframes whose blobs a copy needs.
  CREATE TABLE copied_keyframes(epoch INTEGER, sequence INTEGER, copy INTEGER,
                                PRIMARY KEY(epoch, sequence, copy)) WITHOUT ROWID;
)sql";

Status create_schema(Database& database) {
  sqlite::Transaction transaction(database);
  if (Status status = transaction.begin(); !status) return status;
  const std::string header = fmt::format("PRAGMA application_id = {}; PRAGMA user_version = {};",
                                         kApplicationId, kSchemaVersion);
  if (Status status = database.execute(header + kSchema); !status) return status;
  return transaction.commit();
}

// Ok with `is_new` set for an empty file.
Status check_header(Database& database, const std::string& path, bool& is_new) {
  const auto application = database.query_integer("PRAGMA application_id");
  if (!application) return application.error();
  const auto tables = database.query_integer("SELECT count(*) FROM sqlite_master");
  if (!tables) return tables.error();
  is_new = *application == 0 && *tables == 0;
  if (is_new) return {};
  if (*application != kApplicationId)
    return {
        ErrorCode::kCorrupt,
        path + ": it is a database of another program, no map file of Cairn; name another file"};
  const auto version = database.query_integer("PRAGMA user_version");
  if (!version) return version.error();
  if (*version != kSchemaVersion)
    return {ErrorCode::kVersion,
            fmt::format("{}: map file of version {}, this program reads version {}; use the program"
                        " that wrote it or name another file",
                        path, *version, kSchemaVersion)};
  return {};
}

Status open_database(Database& database, const std::string& path, MapFile::Mode mode) {
  const bool writable = mode == MapFile::Mode::kReadWrite;
  if (Status status =
          database.open(path, writable ? Database::Mode::kReadWrite : Database::Mode::kReadOnly);
      !status)
    return status;
  // Held until the end, so that two servers never write one file.
  if (writable)
    if (Status status = database.execute("PRAGMA locking_mode = EXCLUSIVE"); !status) return status;
  bool is_new = false;
  if (Status status = check_header(database, path, is_new); !status) return status;
  if (!writable && is_new)
    return {ErrorCode::kNotFound, path + ": the file is empty, no map in it"};
  if (!writable) return storage::show_staged(database);
  if (Status status = database.execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL;"
                                       // Takes the lock now, and shows now whether writing works.
                                       "BEGIN IMMEDIATE; COMMIT;");
      !status)
    return status;
  return is_new ? create_schema(database) : Status{};
}

}  // namespace

Status storage::refuse_writing() {
  return {ErrorCode::kInvalidArgument, "map file opened for reading only"};
}

MapFile::MapFile(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}

MapFile::~MapFile() {
  Parts& p = *parts_;
  if (p.in_memory || p.mode == Mode::kReadOnly) return;
  p.insert_keyframe.reset();
  p.count_client.reset();
  p.find_client.reset();
  // Leaves one plain file, readable from a folder without write permission. If it fails, the log
  // beside the file has the rest and the next open() reads it.
  (void)p.database.execute("PRAGMA journal_mode = DELETE");
}

Result<std::unique_ptr<MapFile>> MapFile::open(const std::filesystem::path& path, Mode mode) {
  auto parts = std::make_unique<Parts>();
  parts->mode = mode;
  parts->in_memory = path.empty();
  if (!parts->in_memory) {
    std::error_code ignored;
    if (mode == Mode::kReadOnly && !std::filesystem::exists(path, ignored))
      return {ErrorCode::kNotFound, path.string() + ": no such file"};
    if (std::filesystem::is_directory(path, ignored))
      return {ErrorCode::kInvalidArgument, path.string() + ": is a folder; name a file in it"};
    if (Status status = open_database(parts->database, path.string(), mode); !status)
      return status.error();
    parts->insert_keyframe.emplace(
        parts->database, "INSERT OR IGNORE INTO keyframes(epoch, sequence, blob) VALUES(?, ?, ?)");
    parts->count_client.emplace(parts->database,
                                "INSERT INTO clients VALUES(?, ?, ?) ON CONFLICT DO UPDATE SET"
                                " next_sequence = max(next_sequence, excluded.next_sequence)");
    parts->find_client.emplace(parts->database,
                               "SELECT next_sequence FROM clients WHERE name = ? AND epoch = ?");
    if (mode == Mode::kReadWrite) {
      storage::Pieces pieces(*parts);
      if (Status status = storage::finish_staged(pieces); !status) return status.error();
    }
  }
  return std::unique_ptr<MapFile>(new MapFile(std::move(parts)));
}

void MapFile::set_between_pieces(std::function<bool()> go_on) {
  parts_->between_pieces = std::move(go_on);
}

Status MapFile::append(const ClientId& client, KeyframeId id, std::span<const std::uint8_t> blob) {
  Parts& p = *parts_;
  if (p.mode == Mode::kReadOnly) return storage::refuse_writing();
  const std::lock_guard lock(p.mutex);
  if (p.in_memory) {
    std::uint32_t& next = p.next_sequence[client];
    next = std::max(next, id.sequence + 1);
    return {};
  }
  sqlite::Transaction transaction(p.database);
  if (Status status = transaction.begin(); !status) return status;
  p.insert_keyframe->bind(1, id.epoch).bind(2, id.sequence).bind(3, blob);
  if (Status status = p.insert_keyframe->run(); !status) return status;
  p.count_client->bind(1, client.name).bind(2, client.epoch).bind(3, id.sequence + 1);
  if (Status status = p.count_client->run(); !status) return status;
  return transaction.commit();
}

std::uint32_t MapFile::next_sequence(const ClientId& client) {
  Parts& p = *parts_;
  const std::lock_guard lock(p.mutex);
  if (p.in_memory) {
    const auto known = p.next_sequence.find(client);
    return known == p.next_sequence.end() ? 0 : known->second;
  }
  p.find_client->bind(1, client.name).bind(2, client.epoch);
  const Result<bool> row = p.find_client->step();
  // When reading fails the client sends all again: append() knows what it has.
  if (!row || !*row) return 0;
  const auto next = static_cast<std::uint32_t>(p.find_client->integer(0));
  p.find_client->reset();
  return next;
}

Result<std::vector<ClientId>> MapFile::clients() {
  Parts& p = *parts_;
  const std::lock_guard lock(p.mutex);
  std::vector<ClientId> clients;
  if (p.in_memory) {
    for (const auto& [client, next] : p.next_sequence) clients.push_back(client);
    return clients;
  }
  Statement statement(p.database, "SELECT name, epoch FROM clients");
  Result<bool> row = statement.step();
  for (; row && *row; row = statement.step())
    clients.push_back({statement.text(0), statement.unsigned_integer(1)});
  if (!row) return row.error();
  std::sort(clients.begin(), clients.end());
  return clients;
}

}  // namespace cairn
