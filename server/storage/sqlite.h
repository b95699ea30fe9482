// The little of SQLite that server/storage needs: a connection and prepared statements, with errors
// as values. Private to server/storage. For one thread at a time.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "common/util/status.h"

struct sqlite3;
struct sqlite3_stmt;

namespace cairn::sqlite {

class Database;

// A prepared statement. Blobs and text are bound without a copy: they must live until the step.
//
//   Statement insert(database, "INSERT INTO t VALUES (?, ?)");
//   insert.bind(1, number).bind(2, bytes);
//   if (Status status = insert.run(); !status) ...
class Statement {
 public:
  // An SQL error shows at the first step.
  Statement(Database& database, std::string_view sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(int place, std::int64_t value);  // places count from 1
  Statement& bind(int place, std::uint64_t value) {
    return bind(place, static_cast<std::int64_t>(value));
  }
  Statement& bind(int place, std::uint32_t value) {
    return bind(place, static_cast<std::int64_t>(value));
  }
  Statement& bind(int place, std::string_view text);
  Statement& bind(int place, std::span<const std::uint8_t> blob);
  Statement& bind_null(int place);

  // True: a row is there to read. False: no more rows; the statement is ready to be bound again.
  Result<bool> step();
  // For statements without rows.
  Status run();
  void reset();

  std::int64_t integer(int column) const;  // columns count from 0
  std::uint64_t unsigned_integer(int column) const {
    return static_cast<std::uint64_t>(integer(column));
  }
  std::string text(int column) const;
  // Valid until the next step or reset.
  std::span<const std::uint8_t> blob(int column) const;

 private:
  Database& database_;
  sqlite3_stmt* statement_ = nullptr;
  Error error_;  // why there is no statement
};

class Database {
 public:
  enum class Mode { kReadOnly, kReadWrite };

  Database() = default;
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  Status open(const std::string& path, Mode mode);
  // Runs statements that give no rows, or whose rows don't matter.
  Status execute(const std::string& sql);
  // The first column of the first row; 0 when there is none.
  Result<std::int64_t> query_integer(std::string_view sql);
  // What the last call that failed on this connection complains about, with a code that tells
  // callers what to do.
  Error last_error() const;

 private:
  friend class Statement;
  std::string path_;
  sqlite3* connection_ = nullptr;
};

// Rolls back unless committed.
class Transaction {
 public:
  explicit Transaction(Database& database) : database_(database) {}
  ~Transaction();
  Status begin();
  Status commit();

 private:
  Database& database_;
  bool open_ = false;
};

}  // namespace cairn::sqlite
