#include "server/storage/sqlite.h"

#include <sqlite3.h>

namespace cairn::sqlite {
namespace {

ErrorCode code_of(int result) {
  switch (result & 0xff) {
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return ErrorCode::kCorrupt;
    case SQLITE_ERROR:
    case SQLITE_MISUSE:
      return ErrorCode::kInternal;
    default:  // busy, full, read-only, I/O errors, no such folder
      return ErrorCode::kUnavailable;
  }
}

std::string explain(int result, const char* words) {
  switch (result & 0xff) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "it is in use by another program; stop that one or name another file";
    case SQLITE_NOTADB:
      return "it is no map file of Cairn; name another file";
    case SQLITE_CORRUPT:
      return "the file is damaged; restore a copy or name another file";
    case SQLITE_CANTOPEN:
      return "it cannot be opened; check that the folder is there and may be written to";
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return "it may not be written to; check the permissions of the file and its folder";
    case SQLITE_FULL:
      return "the disk is full";
    default:
      return words;
  }
}

}  // namespace

Statement::Statement(Database& database, std::string_view sql) : database_(database) {
  if (sqlite3_prepare_v2(database.connection_, sql.data(), static_cast<int>(sql.size()),
                         &statement_, nullptr) != SQLITE_OK)
    error_ = database.last_error();
}

Statement::~Statement() {
  sqlite3_finalize(statement_);
}

Statement& Statement::bind(int place, std::int64_t value) {
  if (statement_) sqlite3_bind_int64(statement_, place, value);
  return *this;
}

Statement& Statement::bind(int place, std::string_view text) {
  if (statement_)
    sqlite3_bind_text(statement_, place, text.data(), static_cast<int>(text.size()), SQLITE_STATIC);
  return *this;
}

Statement& Statement::bind(int place, std::span<const std::uint8_t> blob) {
  if (statement_) sqlite3_bind_blob64(statement_, place, blob.data(), blob.size(), SQLITE_STATIC);
  return *this;
}

Statement& Statement::bind_null(int place) {
  if (statement_) sqlite3_bind_null(statement_, place);
  return *this;
}

Result<bool> Statement::step() {
  if (!statement_) return error_;
  const int result = sqlite3_step(statement_);
  if (result == SQLITE_ROW) return true;
  const Error error = result == SQLITE_DONE ? Error{} : database_.last_error();
  sqlite3_reset(statement_);
  if (result == SQLITE_DONE) return false;
  return error;
}

Status Statement::run() {
  const Result<bool> row = step();
  if (!row) return row.error();
  if (*row) reset();
  return {};
}

void Statement::reset() {
  if (statement_) sqlite3_reset(statement_);
}

std::int64_t Statement::integer(int column) const {
  return sqlite3_column_int64(statement_, column);
}

std::string Statement::text(int column) const {
  const unsigned char* text = sqlite3_column_text(statement_, column);
  return text ? reinterpret_cast<const char*>(text) : "";
}

std::span<const std::uint8_t> Statement::blob(int column) const {
  const auto* bytes = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_, column));
  return {bytes, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column))};
}

Database::~Database() {
  sqlite3_close_v2(connection_);
}

Status Database::open(const std::string& path, Mode mode) {
  path_ = path;
  const int flags =
      mode == Mode::kReadOnly ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  if (sqlite3_open_v2(path.c_str(), &connection_, flags | SQLITE_OPEN_NOMUTEX, nullptr) !=
      SQLITE_OK)
    return last_error();
  return {};
}

Status Database::execute(const std::string& sql) {
  if (sqlite3_exec(connection_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    return last_error();
  return {};
}

Result<std::int64_t> Database::query_integer(std::string_view sql) {
  Statement statement(*this, sql);
  const Result<bool> row = statement.step();
  if (!row) return row.error();
  return *row ? statement.integer(0) : 0;
}

Error Database::last_error() const {
  const int result = sqlite3_extended_errcode(connection_);
  return {code_of(result), path_ + ": " + explain(result, sqlite3_errmsg(connection_))};
}

Transaction::~Transaction() {
  // Nothing is left to do when even that fails: the file keeps its last committed state.
  if (open_) (void)database_.execute("ROLLBACK");
}

Status Transaction::begin() {
  Status status = database_.execute("BEGIN IMMEDIATE");
  open_ = status.ok();
  return status;
}

Status Transaction::commit() {
  Status status = database_.execute("COMMIT");
  if (status.ok()) open_ = false;
  return status;
}

}  // namespace cairn::sqlite
