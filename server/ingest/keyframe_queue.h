// The keyframes of all client runs between the wire and the map: put into order, journaled, handed
// out fairly. Knows nothing of DDS.
//
// A run's keyframes are journaled in the order of their sequence; one that comes early waits for
// those before it, one that has been before is recognised. Each run has room for `capacity`
// keyframes: those that wait here and those that were handed out and are not done yet. What a
// client may send follows from that (window()).
//
// Threads: next() is for the consumer; offer(), window() and forget() for one other thread; the
// rest, done() included, for any.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>

#include "common/model/keyframe.h"
#include "common/wire/bytes.h"
#include "server/ingest/ingest.h"
#include "server/ingest/journal.h"

namespace cairn {

class KeyframeQueue {
 public:
  enum class Arrival {
    kAccepted,     // journaled, and with it those that have waited for it
    kEarly,        // waits for an earlier one
    kDuplicate,    // is here already
    kBeyond,       // no room; must be sent again
    kNotJournaled  // the journal failed; must be sent again
  };
  struct Window {
    std::uint32_t next_sequence = 0;  // everything below is journaled
    std::uint32_t credits = 0;        // keyframes from next_sequence on that there is room for
  };

  // `on_room` is called from done(), outside of any lock, when a run whose window had become small
  // has room again.
  KeyframeQueue(Journal& journal, std::uint32_t capacity, std::function<void()> on_room)
      : journal_(journal), capacity_(capacity), on_room_(std::move(on_room)) {}

  // `oldest`: the lowest sequence that the client still holds. Lower ones have been acknowledged,
  // by a former server if not by this one, and are not waited for.
  Arrival offer(const ClientId& client, std::uint32_t oldest, KeyframePtr keyframe,
                wire::Bytes blob);
  Window window(const ClientId& client);
  // The run has ended: what it has journaled is still handed out.
  void forget(const ClientId& client);

  // Each keyframe takes room until done() is called for its run.
  std::optional<IncomingKeyframe> next(std::stop_token stop);
  void done(const ClientId& client);
  void close();  // next() ends when all is handed out

  std::uint32_t queued() const;                        // waiting here, of all runs
  std::uint32_t queued(const ClientId& client) const;  // of the run, not done yet
  std::uint64_t accepted() const;                      // journaled since the start
  std::uint64_t journal_failures() const;

 private:
  struct Early {
    KeyframePtr keyframe;
    wire::Blob blob;
  };
  struct Run {
    // The offering thread only.
    bool opened = false;
    std::uint32_t next_sequence = 0;
    std::map<std::uint32_t, Early> early;
    bool forgotten = false;  // guarded, as are:
    bool wants_room = false;
    std::deque<IncomingKeyframe> ready;
    std::uint32_t handed_out = 0;  // and not done
  };

  Run& open(const ClientId& client);
  static std::uint32_t taken(const Run& run);
  std::uint32_t room(const Run& run) const;
  bool admit(const ClientId& client, Run& run, KeyframePtr keyframe, wire::Bytes blob);

  Journal& journal_;
  const std::uint32_t capacity_;
  const std::function<void()> on_room_;

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<ClientId, Run> runs_;
  std::optional<ClientId> served_last_;
  bool closed_ = false;
  std::uint32_t queued_ = 0;
  std::uint64_t accepted_ = 0, journal_failures_ = 0;
};

}  // namespace cairn
