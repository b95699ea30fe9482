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

namespace storage {

Status refuse_writing();
// What is wrong with the file, and what to do.
Error corrupt(const std::string& what);
// A keyframe of the journal; kCorrupt when it is unreadable or another one.
Result<wire::DecodedKeyframe> decode_keyframe(std::span<const std::uint8_t> blob, KeyframeId id);
// Stores the blobs of those keyframes of the map that did not come through append(), or came and
// were dropped since. Within a transaction.
Status store_missing_blobs(MapFile::Parts& parts, const std::vector<KeyframeId>& ids,
                           const Map& map);

}  // namespace storage

}  // namespace cairn
