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
// Before a loop is closed or a part merged, the estimate as it is can be kept as a checkpoint, so
// that a wrong one can be undone. The journal holds what came since: after restore() those
// keyframes are pending again. (Of what came since, keyframes culled as redundant are gone.)
//
// The file is held by one process at a time. Blobs of culled keyframes are dropped at the next
// save, but for those that a checkpoint needs, so the file grows with the place and not with the
// time spent in it.
//
// Without a path nothing is stored: sequences are counted in memory and all else is forgotten.
//
// Threads: all members are safe from any thread. save_map() and save_checkpoint() compare and
// encode outside the lock and write in pieces of a thousand rows or a megabyte; append() waits for
// one such piece at most. One of the two runs at a time.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/util/status.h"
#include "common/wire/keyframe_codec.h"
#include "server/ingest/journal.h"
#include "server/map/map.h"

namespace cairn {

// What a long write was made of.
struct WriteTimes {
  std::size_t pieces = 0;                     // transactions
  std::size_t most_rows = 0, most_bytes = 0;  // in one piece
  double locked_ms = 0, longest_ms = 0;       // append() waits: of all pieces, and of one
};

struct SaveSummary {
  std::size_t keyframes = 0, landmarks = 0;  // written because new or changed
  std::size_t dropped_blobs = 0;             // of culled keyframes
  double milliseconds = 0;                   // all in all
  WriteTimes writing{};
};

struct CheckpointSummary {
  std::size_t event = 0;    // that it goes back to before
  std::size_t bytes = 0;    // kept, besides blobs of keyframes
  double milliseconds = 0;  // as above
  WriteTimes writing{};
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

  // Replaces the saved map, all at once however many pieces it takes: after a failure or a crash
  // the file holds either the map that was saved before or this one. Keyframes that were never
  // journaled are stored too.
  Result<SaveSummary> save_map(const Map& map);
  // How many of the latest events can be undone, unless told otherwise.
  static constexpr std::size_t kCheckpoints = 3;
  // Keeps what it takes to go back to `before`, the map as it was before its next event: number
  // before.loops.size() + 1, counted from 1. After a failure or a crash the file keeps what it kept
  // before. Call it when that event has been applied, with a snapshot from just before; what
  // arrived in between will be pending. Replaces what was kept for this event or later ones; all
  // but the last `keep` are dropped.
  Result<CheckpointSummary> save_checkpoint(const Map& before, std::size_t keep = kCheckpoints);
  // The events, ascending, that there is a checkpoint for.
  Result<std::vector<std::size_t>> checkpoints();
  // The map as it was before the event. kNotFound: nothing is kept for it. kCorrupt: damaged.
  Result<Map> load_checkpoint(std::size_t event);
  // Makes load_checkpoint(event) the saved map, as save_map() does; the event and what came after
  // it are gone. For a file that no server goes on with: a running one would save its map again.
  // Errors as above, and kNotFound when the saved map has no such event; the file stays as it was.
  Status restore(std::size_t event);

  // Nothing when none has been saved yet. The map equals the saved one.
  Result<std::optional<Map>> load_map();
  // Journaled but neither in the saved map nor culled from it, in order of their arrival. Those
  // that were saved before they were mapped are Map::unmapped().
  Result<std::vector<wire::DecodedKeyframe>> pending_keyframes();
  // All client runs that ever delivered keyframes, ascending.
  Result<std::vector<ClientId>> clients();

  // Called between two pieces of a save, when nothing is locked. When it returns false the save
  // ends there, as it would if the process died. For tests of just that; set it before any save.
  void set_between_pieces(std::function<bool()> go_on);

  struct Parts;  // private to server/storage

 private:
  explicit MapFile(std::unique_ptr<Parts> parts);
  // Saves, and drops the checkpoints from event `undone` on. With the save mutex taken.
  Result<SaveSummary> replace_map(const Map& map, std::optional<std::size_t> undone);

  std::unique_ptr<Parts> parts_;
};

}  // namespace cairn
