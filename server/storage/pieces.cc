#include "server/storage/pieces.h"

#include <algorithm>

#include "common/util/clock.h"

namespace cairn::storage {

Status Pieces::one(const std::function<Status(sqlite::Database&)>& write) {
  if (parts_.between_pieces && times_.pieces > 0 && !parts_.between_pieces())
    return {ErrorCode::kUnavailable, "saving was broken off"};
  const std::lock_guard lock(parts_.mutex);
  const Stopwatch watch;
  sqlite::Transaction transaction(parts_.database);
  Status status = transaction.begin();
  if (status) status = write(parts_.database);
  if (status) status = transaction.commit();
  ++times_.pieces;
  const double ms = watch.milliseconds();
  times_.locked_ms += ms;
  times_.longest_ms = std::max(times_.longest_ms, ms);
  return status;
}

Status Pieces::rows(std::size_t count, const WriteRows& write) {
  for (std::size_t first = 0; first < count;) {
    Status status = one([&](sqlite::Database& database) -> Status {
      Room room;
      const Result<std::size_t> next = write(database, first, room);
      if (!next) return next.error();
      first = *next;
      times_.most_rows = std::max(times_.most_rows, room.rows());
      times_.most_bytes = std::max(times_.most_bytes, room.bytes());
      return {};
    });
    if (!status) return status;
  }
  return {};
}

Status Pieces::repeat(const std::string& sql, std::size_t* changed) {
  for (std::int64_t last = 1; last > 0;) {
    Status status = one([&](sqlite::Database& database) -> Status {
      if (Status s = database.execute(sql); !s) return s;
      const auto changes = database.query_integer("SELECT changes()");
      if (!changes) return changes.error();
      last = *changes;
      return {};
    });
    if (!status) return status;
    if (changed) *changed += static_cast<std::size_t>(last);
  }
  return {};
}

}  // namespace cairn::storage
