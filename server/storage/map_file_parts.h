// What a MapFile consists of. Private to server/storage.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <optional>

#include "server/storage/fair_mutex.h"
#include "server/storage/map_file.h"
#include "server/storage/sqlite.h"

namespace cairn {

struct MapFile::Parts {
  Mode mode = Mode::kReadWrite;
  bool in_memory = false;
  std::map<ClientId, std::uint32_t> next_sequence;  // in memory, guarded by mutex

  FairMutex mutex;  // guards the connection and the statements
  sqlite::Database database;
  // Kept ready for append().
  std::optional<sqlite::Statement> insert_keyframe, count_client, find_client;

  // What the file's estimate is, as far as known: to write only what differs. Parts that two copies
  // of a map share are known by their address to be alike.
  std::mutex save_mutex;  // one long write at a time; taken before `mutex`
  std::optional<Map> saved;
  std::function<bool()> between_pieces;  // see MapFile::set_between_pieces()
};

namespace storage {

Status refuse_writing();
// What is wrong with the file, and what to do.
Error corrupt(const std::string& what);
// A keyframe of the journal; kCorrupt when it is unreadable or another one.
Result<wire::DecodedKeyframe> decode_keyframe(std::span<const std::uint8_t> blob, KeyframeId id);
class Pieces;
// Stores the blobs of those keyframes of the map that did not come through append(), or came and
// were dropped since.
Status store_missing_blobs(MapFile::Parts& parts, Pieces& pieces,
                           const std::vector<KeyframeId>& ids, const Map& map);
// Removes what no checkpoint needs any more, or one that was never finished.
Status drop_loose_copies(Pieces& pieces);

}  // namespace storage

}  // namespace cairn
