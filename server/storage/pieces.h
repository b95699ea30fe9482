// Long writes in pieces: many short transactions instead of a long one, so that append() waits for
// a piece at most. What is written this way must mean nothing until a last, small piece says so.
// Private to server/storage.
#pragma once

#include <cstddef>
#include <functional>

#include "server/storage/map_file_parts.h"

namespace cairn::storage {

// What one piece may still write.
class Room {
 public:
  // Some ten milliseconds of writing, on slow disks too.
  static constexpr std::size_t kRows = 1000, kBytes = 1 << 20;

  bool left() const { return rows_ < kRows && bytes_ < kBytes; }
  // A row was written or looked at.
  void take(std::size_t bytes) {
    ++rows_;
    bytes_ += bytes;
  }
  std::size_t rows() const { return rows_; }
  std::size_t bytes() const { return bytes_; }

 private:
  std::size_t rows_ = 0, bytes_ = 0;
};

// Statements belong to a piece: nothing may touch the connection in between.
class Pieces {
 public:
  explicit Pieces(MapFile::Parts& parts) : parts_(parts) {}

  // A transaction. When `write` fails nothing of it stays.
  Status one(const std::function<Status(sqlite::Database&)>& write);
  // Rows 0 to count-1. `write` writes from `first` on while there is room, and gives where the next
  // piece begins.
  using WriteRows =
      std::function<Result<std::size_t>(sqlite::Database&, std::size_t first, Room& room)>;
  Status rows(std::size_t count, const WriteRows& write);
  // A statement that changes a limited number of rows, until it changes none. `changed`, where
  // wanted, is told how many in all.
  Status repeat(const std::string& sql, std::size_t* changed = nullptr);

  const WriteTimes& times() const { return times_; }

 private:
  MapFile::Parts& parts_;
  WriteTimes times_;
};

}  // namespace cairn::storage
