// The map on disk: one SQLite file with the journal of keyframes and the saved estimate.
//
// A keyframe's blob is written once, when it arrives, and stays as part of the saved map: saving
// writes only the estimate (poses, landmarks), and of that only what has changed since. A crash
// between two saves costs the estimate's progress but no keyframe: pending_keyframes() returns
// those that the saved map does not know, to be mapped again.
//
// Durability: write-ahead log with synchronous=NORMAL. What append() has confirmed survives the
// death of the process (kill -9); only a crash of the whole machine can take the last moments.
//
// The file is held by one process at a time. Blobs of culled keyframes are dropped at the next
// save, so the file grows with the place and not with the time spent in it.
//
// Without a path nothing is stored: sequences are counted in memory and all else is forgotten.
//
// Threads: all members are safe from any thread. save_map() compares and encodes outside the lock;
// append() waits for it only while the changed rows are written.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "common/util/status.h"
#include "common/wire/keyframe_codec.h"
#include "server/ingest/journal.h"
#include "server/map/map.h"

namespace cairn {

struct SaveSummary {
  std::size_t keyframes = 0, landmarks = 0;  // written because new or changed
  std::size_t dropped_blobs = 0;             // of culled keyframes
  double milliseconds = 0, locked_ms = 0;    // all in all, and of that with append() waiting
};

class MapFile final : public Journal {
 public:
  enum class Mode {
    kReadWrite,  // makes the file when it is not there
    kReadOnly,   // for tools: append() and save_map() fail
  };

  // An empty path: in memory. kNotFound: read-only and no such file. kVersion: a file of another
  // version of Cairn. kCorrupt: damaged, or no map file. kUnavailable: in use by another process,
  // no such folder, or no permission.
  static Result<std::unique_ptr<MapFile>> open(const std::filesystem::path& path,
                                               Mode mode = Mode::kReadWrite);
  ~MapFile() override;

  Status append(const ClientId& client, KeyframeId id, std::span<const std::uint8_t> blob) override;
  std::uint32_t next_sequence(const ClientId& client) override;

  // Replaces the saved map, in one transaction: after a failure or a crash the file holds the map
  // that was saved before. Keyframes that were never journaled are stored too.
  Result<SaveSummary> save_map(const Map& map);
  // Nothing when none has been saved yet. The map equals the saved one.
  Result<std::optional<Map>> load_map();
  // Journaled but neither in the saved map nor culled from it, in order of their arrival. Those
  // that were saved before they were mapped are Map::unmapped().
  Result<std::vector<wire::DecodedKeyframe>> pending_keyframes();
  // All client runs that ever delivered keyframes, ascending.
  Result<std::vector<ClientId>> clients();

 private:
  struct Parts;
  explicit MapFile(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace cairn
