#include "server/storage/staged.h"

#include <fmt/format.h>

namespace cairn::storage {
namespace {

using sqlite::Database;
using sqlite::Statement;

const char* name_of(Table table) {
  switch (table) {
    case Table::kNodes:
      return "nodes";
    case Table::kLandmarks:
      return "landmarks";
    case Table::kReplacedLandmarks:
      return "replaced_landmarks";
    case Table::kRemovedKeyframes:
      break;
  }
  return "removed_keyframes";
}

Result<bool> is_accepted(Database& database) {
  const auto staged = database.query_integer("SELECT staged FROM map");
  if (!staged) return staged.error();
  return *staged != 0;
}

Status move_piece(Database& database, std::int64_t piece) {
  for (const Table table : kTables) {
    const std::string of_piece =
        fmt::format("FROM staged WHERE piece = {} AND target = {}", piece, static_cast<int>(table));
    Status status = database.execute(
        fmt::format("INSERT OR REPLACE INTO {0} SELECT origin, number, data {1} AND data IS NOT"
                    " NULL; DELETE FROM {0} WHERE (origin, number) IN"
                    " (SELECT origin, number {1} AND data IS NULL);",
                    name_of(table), of_piece));
    if (!status) return status;
  }
  return database.execute(fmt::format("DELETE FROM staged WHERE piece = {}", piece));
}

// Piece by piece as they were staged.
Status move_all(Pieces& pieces) {
  for (bool done = false; !done;) {
    Status status = pieces.one([&](Database& database) -> Status {
      const auto piece = database.query_integer("SELECT min(piece) FROM staged");
      if (!piece) return piece.error();
      done = *piece == 0;
      return done ? database.execute("UPDATE map SET staged = 0") : move_piece(database, *piece);
    });
    if (!status) return status;
  }
  return {};
}

}  // namespace

Status stage(Pieces& pieces, const std::vector<StagedRow>& rows) {
  std::int64_t piece = 0;
  return pieces.rows(rows.size(),
                     [&](Database& database, std::size_t i, Room& room) -> Result<std::size_t> {
                       Statement write(database, "INSERT INTO staged VALUES(?, ?, ?, ?, ?)");
                       write.bind(1, ++piece);
                       for (; i < rows.size() && room.left(); ++i) {
                         const StagedRow& row = rows[i];
                         write.bind(2, std::int64_t{static_cast<int>(row.table)})
                             .bind(3, row.origin)
                             .bind(4, row.number);
                         if (row.data.empty())
                           write.bind_null(5);
                         else
                           write.bind(5, row.data);
                         if (Status status = write.run(); !status) return status.error();
                         room.take(row.data.size());
                       }
                       return i;
                     });
}

Status accept_staged(Database& database) {
  return database.execute("UPDATE map SET staged = 1");
}

Status finish_staged(Pieces& pieces) {
  bool accepted = false;
  Status status = pieces.one([&](Database& database) -> Status {
    const auto known = is_accepted(database);
    if (!known) return known.error();
    accepted = *known;
    return {};
  });
  if (!status) return status;
  if (accepted) return move_all(pieces);
  return pieces.repeat("DELETE FROM staged WHERE piece = (SELECT min(piece) FROM staged)");
}

// Tables of the connection's own come before those of the file with the same name.
Status show_staged(Database& database) {
  const auto accepted = is_accepted(database);
  if (!accepted) return accepted.error();
  if (!*accepted) return {};
  Status status = database.execute(
      "PRAGMA temp_store = MEMORY;"
      "CREATE TEMP TABLE over(target INTEGER, origin INTEGER, number INTEGER, data BLOB,"
      " PRIMARY KEY(target, origin, number)) WITHOUT ROWID;"
      "INSERT INTO over SELECT target, origin, number, data FROM staged;");
  for (const Table table : kTables)
    if (status)
      status = database.execute(fmt::format(
          "CREATE TEMP VIEW {0} AS SELECT origin, number, data FROM main.{0} t WHERE NOT EXISTS"
          " (SELECT 1 FROM over o WHERE o.target = {1} AND o.origin = t.origin AND"
          "  o.number = t.number)"
          " UNION ALL SELECT origin, number, data FROM over WHERE target = {1} AND"
          " data IS NOT NULL",
          name_of(table), static_cast<int>(table)));
  return status;
}

}  // namespace cairn::storage
