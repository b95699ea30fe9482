#include "client/link/outbox.h"

#include <sqlite3.h>

#include <algorithm>
#include <system_error>

#include "common/wire/envelope.h"

namespace cairn {
namespace {

constexpr std::int64_t kApplicationId = 0x43524E4F;  // "CRNO", in the header of the file
constexpr std::int64_t kVersion = 3;                 // 3: keyframes of format 4

static_assert(wire::kKeyframeFormat.version == 4, "another keyframe format, another kVersion");

constexpr char kTables[] =
    "CREATE TABLE owner(client TEXT NOT NULL);"
    "CREATE TABLE keyframe(place INTEGER PRIMARY KEY AUTOINCREMENT, epoch INTEGER NOT NULL,"
    " sequence INTEGER NOT NULL, blob BLOB NOT NULL, UNIQUE(epoch, sequence));";

// SQLite's integers are signed; epochs use all 64 bits.
std::int64_t to_sql(std::uint64_t epoch) {
  return static_cast<std::int64_t>(epoch);
}

}  // namespace

void Outbox::CloseDatabase::operator()(sqlite3* database) const {
  sqlite3_close_v2(database);
}
void Outbox::FinishStatement::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

Outbox::~Outbox() = default;

Error Outbox::error(int code) const {
  const std::string file = "outbox " + path_.string();
  switch (code & 0xff) {
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return {ErrorCode::kCorrupt, file + ": not an outbox or damaged; move it away to start anew"};
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return {ErrorCode::kUnavailable, file + ": in use by another process; give another --outbox"};
    case SQLITE_CANTOPEN:
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return {ErrorCode::kUnavailable,
              file + ": cannot be opened for writing; check the folder and its permissions"};
    default:
      return {ErrorCode::kUnavailable, file + ": " + sqlite3_errstr(code)};
  }
}

Status Outbox::execute(const char* sql) {
  const int code = sqlite3_exec(database_.get(), sql, nullptr, nullptr, nullptr);
  return code == SQLITE_OK ? Status() : Status(error(code));
}

Result<Outbox::Statement> Outbox::prepare(const char* sql) {
  sqlite3_stmt* statement = nullptr;
  const int code = sqlite3_prepare_v2(database_.get(), sql, -1, &statement, nullptr);
  if (code != SQLITE_OK) return error(code);
  return Statement(statement);
}

Result<std::int64_t> Outbox::read_number(const char* sql) {
  auto statement = prepare(sql);
  if (!statement) return statement.error();
  const int code = sqlite3_step(statement->get());
  if (code != SQLITE_ROW) return error(code == SQLITE_DONE ? SQLITE_CORRUPT : code);
  return std::int64_t{sqlite3_column_int64(statement->get(), 0)};
}

Result<std::unique_ptr<Outbox>> Outbox::open(const std::filesystem::path& path,
                                             const std::string& client) {
  std::unique_ptr<Outbox> outbox(new Outbox(path));
  if (Status s = outbox->open_database(); !s) return s.error();
  if (Status s = outbox->check_owner(client); !s) return s.error();
  if (Status s = outbox->load(); !s) return s.error();
  return outbox;
}

Status Outbox::open_database() {
  sqlite3* database = nullptr;
  const int code = sqlite3_open_v2(path_.c_str(), &database,
                                   SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  database_.reset(database);
  if (code != SQLITE_OK) return error(code);
  // One owner: a second process is told at once, and no shared memory file is needed.
  return execute("PRAGMA locking_mode=EXCLUSIVE");
}

Status Outbox::check_owner(const std::string& client) {
  const auto application = read_number("PRAGMA application_id");
  if (!application) return application.error();
  const auto tables = read_number("SELECT count(*) FROM sqlite_master");
  if (!tables) return tables.error();
  if (*application == 0 && *tables == 0) return create_tables(client);
  if (*application != kApplicationId)
    return {ErrorCode::kCorrupt,
            "outbox " + path_.string() + ": a database of another program; give another --outbox"};
  const auto version = read_number("PRAGMA user_version");
  if (!version) return version.error();
  if (*version != kVersion)
    return {ErrorCode::kVersion,
            "outbox " + path_.string() + ": written by another version of Cairn (format " +
                std::to_string(*version) + ", this one reads " + std::to_string(kVersion) +
                "); deliver it with that one or move it away"};
  if (Status s = execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; BEGIN IMMEDIATE; "
                         "COMMIT");
      !s)
    return s;
  auto statement = prepare("SELECT client FROM owner");
  if (!statement) return statement.error();
  if (sqlite3_step(statement->get()) != SQLITE_ROW) return error(SQLITE_CORRUPT);
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement->get(), 0));
  const std::string owner = text == nullptr ? "" : text;
  if (owner != client)
    return {ErrorCode::kInvalidArgument, "outbox " + path_.string() + ": belongs to client '" +
                                             owner + "'; run with --name " + owner +
                                             " or give another --outbox"};
  return {};
}

Status Outbox::create_tables(const std::string& client) {
  const std::string marks = "PRAGMA application_id=" + std::to_string(kApplicationId) +
                            "; PRAGMA user_version=" + std::to_string(kVersion) + ";";
  if (Status s = execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; BEGIN IMMEDIATE"); !s)
    return s;
  if (Status s = execute(kTables); !s) return s;
  auto insert = prepare("INSERT INTO owner VALUES(?)");
  if (!insert) return insert.error();
  sqlite3_bind_text(insert->get(), 1, client.data(), static_cast<int>(client.size()),
                    SQLITE_TRANSIENT);
  if (const int code = sqlite3_step(insert->get()); code != SQLITE_DONE) return error(code);
  if (Status s = execute(marks.c_str()); !s) return s;
  return execute("COMMIT");
}

Status Outbox::load() {
  auto list = prepare("SELECT epoch, sequence FROM keyframe ORDER BY place");
  if (!list) return list.error();
  int code = SQLITE_OK;
  while ((code = sqlite3_step(list->get())) == SQLITE_ROW) {
    const std::int64_t sequence = sqlite3_column_int64(list->get(), 1);
    const auto epoch = static_cast<std::uint64_t>(sqlite3_column_int64(list->get(), 0));
    if (epoch == 0 || sequence < 0 || sequence > UINT32_MAX) return error(SQLITE_CORRUPT);
    waiting_.push_back({epoch, static_cast<std::uint32_t>(sequence)});
  }
  if (code != SQLITE_DONE) return error(code);
  const auto use = [this](const char* sql, Statement& statement) -> Status {
    auto prepared = prepare(sql);
    if (!prepared) return prepared.error();
    statement = std::move(*prepared);
    return {};
  };
  if (Status s = use("INSERT INTO keyframe(epoch, sequence, blob) VALUES(?,?,?)", put_); !s)
    return s;
  if (Status s = use("SELECT blob FROM keyframe WHERE epoch=? AND sequence=?", get_); !s) return s;
  return use("DELETE FROM keyframe WHERE epoch=? AND sequence<?", remove_);
}

Status Outbox::put(KeyframeId id, wire::Bytes blob) {
  if (!waiting_.empty() && waiting_.back().epoch == id.epoch &&
      waiting_.back().sequence + 1 != id.sequence)
    return {ErrorCode::kInvalidArgument, "outbox: keyframe " + std::to_string(id.sequence) +
                                             " does not follow " +
                                             std::to_string(waiting_.back().sequence)};
  sqlite3_reset(put_.get());
  sqlite3_bind_int64(put_.get(), 1, to_sql(id.epoch));
  sqlite3_bind_int64(put_.get(), 2, id.sequence);
  sqlite3_bind_blob64(put_.get(), 3, blob.data(), blob.size(), SQLITE_STATIC);
  const int code = sqlite3_step(put_.get());
  sqlite3_reset(put_.get());
  sqlite3_clear_bindings(put_.get());
  if (code != SQLITE_DONE) return error(code);
  waiting_.push_back(id);
  return {};
}

Result<wire::Blob> Outbox::get(KeyframeId id) {
  sqlite3_reset(get_.get());
  sqlite3_bind_int64(get_.get(), 1, to_sql(id.epoch));
  sqlite3_bind_int64(get_.get(), 2, id.sequence);
  const int code = sqlite3_step(get_.get());
  if (code != SQLITE_ROW) {
    sqlite3_reset(get_.get());
    return error(code == SQLITE_DONE ? SQLITE_CORRUPT : code);
  }
  const auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(get_.get(), 0));
  const int size = sqlite3_column_bytes(get_.get(), 0);
  wire::Blob blob(data, data + size);
  sqlite3_reset(get_.get());
  return blob;
}

Status Outbox::remove_before(std::uint64_t epoch, std::uint32_t sequence) {
  const auto done = [&](KeyframeId id) { return id.epoch == epoch && id.sequence < sequence; };
  if (std::none_of(waiting_.begin(), waiting_.end(), done)) return {};
  sqlite3_reset(remove_.get());
  sqlite3_bind_int64(remove_.get(), 1, to_sql(epoch));
  sqlite3_bind_int64(remove_.get(), 2, sequence);
  const int code = sqlite3_step(remove_.get());
  sqlite3_reset(remove_.get());
  if (code != SQLITE_DONE) return error(code);
  std::erase_if(waiting_, done);
  return {};
}

void Outbox::remove_file() {
  put_.reset();
  get_.reset();
  remove_.reset();
  database_.reset();
  waiting_.clear();
  std::error_code ignored;  // a file that stays behind is empty and does no harm
  std::filesystem::remove(path_, ignored);
  for (const char* suffix : {"-wal", "-shm", "-journal"})
    std::filesystem::remove(path_.string() + suffix, ignored);
}

}  // namespace cairn
