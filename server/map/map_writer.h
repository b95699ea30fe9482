// The one that changes a map: a thread that applies events in order and publishes a snapshot after
// each. Everyone else reads snapshots and sends events.
//
//   MapWriter writer(std::move(map));
//   Applied applied = writer.submit(keyframe);              // waits until it is applied
//   Snapshot map = writer.snapshot();                       // never waits for an event
//   MapDelta delta = solve(*map);                           // for as long as it takes
//   writer.submit(std::move(delta));
//
// Applying an event takes milliseconds; nothing that takes longer belongs here.
#pragma once

#include <cstddef>
#include <future>
#include <mutex>
#include <optional>
#include <thread>
#include <variant>

#include "common/util/bounded_queue.h"
#include "server/map/apply.h"
#include "server/map/delta.h"
#include "server/map/map.h"

namespace cairn {

// A keyframe arrived; a stage or a solver has a result; a loop was found.
using MapEvent = std::variant<KeyframePtr, MapDelta, LoopClosure>;

struct Applied {
  bool done = false;         // false: the writer was closed before
  KeyframeSummary keyframe;  // for a KeyframePtr
  DeltaSummary delta;        // for a MapDelta or a LoopClosure
  Snapshot snapshot;         // the map after this event, before any later one; null when not done
};

// All members but the destructor are safe to call from any thread.
class MapWriter {
 public:
  // Throws nothing but what std::jthread does when the system has no more threads.
  explicit MapWriter(Map initial, std::size_t queue_capacity = 64);
  ~MapWriter();
  MapWriter(const MapWriter&) = delete;
  MapWriter& operator=(const MapWriter&) = delete;

  // The map after the last event applied. Never null. Cheap: copies a pointer.
  Snapshot snapshot() const;

  // Puts an event at the end of the queue; waits for room while it is full.
  std::future<Applied> post(MapEvent event);
  // Posts an event and waits until it is applied. Not from the writer's own thread.
  Applied submit(MapEvent event) { return post(std::move(event)).get(); }

  // Applies what is in the queue, then ends the thread. Later events come back not done.
  void close();

 private:
  struct Entry {
    MapEvent event;
    std::promise<Applied> applied;
  };
  void run();
  Snapshot publish();

  Map map_;  // the thread's alone, once that runs
  mutable std::mutex mutex_;
  Snapshot published_;  // guarded by mutex_
  BoundedQueue<std::shared_ptr<Entry>> queue_;
  std::once_flag joined_;
  std::jthread thread_;
};

}  // namespace cairn
