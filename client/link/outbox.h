// The file in which keyframes wait until the server has them: an SQLite database.
//
// A keyframe that put() has taken survives the end of this process, however it comes about. (After
// a power cut the last moments may be missing: the file is not flushed to the disk at each
// keyframe.) One process at a time can have an outbox open. For one thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <memory>
#include <string>

#include "common/model/ids.h"
#include "common/util/status.h"
#include "common/wire/bytes.h"

struct sqlite3;
struct sqlite3_stmt;

namespace cairn {

class Outbox {
 public:
  // Makes the file when it is missing. kCorrupt: not an outbox, or a damaged one; kVersion: of
  // another version; kInvalidArgument: it belongs to another client; kUnavailable: in use, or the
  // place cannot be written.
  static Result<std::unique_ptr<Outbox>> open(const std::filesystem::path& path,
                                              const std::string& client);
  ~Outbox();
  Outbox(const Outbox&) = delete;
  Outbox& operator=(const Outbox&) = delete;

  // Sequences of one epoch must follow each other without gaps.
  Status put(KeyframeId id, wire::Bytes blob);
  Result<wire::Blob> get(KeyframeId id);
  // Forgets keyframes of that epoch with a lower sequence.
  Status remove_before(std::uint64_t epoch, std::uint32_t sequence);

  // What waits, in the order of delivery: earlier runs first, each by sequence.
  const std::deque<KeyframeId>& waiting() const { return waiting_; }

  // Closes the database and deletes its file; nothing else may be called after.
  void remove_file();

 private:
  struct CloseDatabase {
    void operator()(sqlite3* database) const;
  };
  struct FinishStatement {
    void operator()(sqlite3_stmt* statement) const;
  };
  using Statement = std::unique_ptr<sqlite3_stmt, FinishStatement>;

  explicit Outbox(std::filesystem::path path) : path_(std::move(path)) {}
  Status open_database();
  Status check_owner(const std::string& client);
  Status create_tables(const std::string& client);
  Status load();
  Status execute(const char* sql);
  Result<Statement> prepare(const char* sql);
  Result<std::int64_t> read_number(const char* sql);
  Error error(int code) const;

  std::filesystem::path path_;
  std::unique_ptr<sqlite3, CloseDatabase> database_;
  Statement put_, get_, remove_;
  std::deque<KeyframeId> waiting_;
};

}  // namespace cairn
