// What a MapFile consists of. Private to server/storage.
#pragma once

#include <map>
#include <mutex>
#include <optional>

#include "server/storage/map_file.h"
#include "server/storage/sqlite.h"

namespace cairn {

struct MapFile::Parts {
  Mode mode = Mode::kReadWrite;
  bool in_memory = false;
  std::map<ClientId, std::uint32_t> next_sequence;  // in memory, guarded by mutex

  std::mutex mutex;  // guards the connection and the statements
  sqlite::Database database;
  // Kept ready for append().
  std::optional<sqlite::Statement> insert_keyframe, count_client, find_client;

  // What the file's estimate is, as far as known: to write only what differs. Parts that two copies
  // of a map share are known by their address to be alike.
  std::mutex save_mutex;  // taken before `mutex`
  std::optional<Map> saved;
};

}  // namespace cairn
