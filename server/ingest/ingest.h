// The server's side of the wire: takes keyframes of all clients, journals and acknowledges them,
// and hands them out in order, fairly; sends map updates.
//
// Per client run keyframes come out of next() in the order of their sequence, each exactly once.
// Backpressure: a client may send as many as there is room for (credits), so nothing that has been
// acknowledged is ever dropped. A keyframe takes room until it is done(): the rest stays in the
// client's outbox, however long the work on each one takes.
//
// Threads: one of its own receives, checks, journals and acknowledges. next() is for one consumer;
// done(), publish(), answer() and the rest are safe from any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/model/ids.h"
#include "common/model/keyframe.h"
#include "common/model/map_update.h"
#include "common/model/relocalise.h"
#include "common/util/status.h"
#include "server/ingest/journal.h"

namespace cairn {

struct IncomingKeyframe {
  ClientId client;  // the run that made it; not always the one that is connected
  KeyframePtr keyframe;
  std::chrono::steady_clock::time_point arrived;
};

struct ClientEvent {
  enum class Kind {
    kJoined,     // a new run of a client, or one that the server did not know since its own start:
                 // send it a full refresh first
    kRefresh,    // has missed an update: the next one must be a full refresh
    kFinishing,  // has made its last keyframe and waits for the last corrections
    kLeft,       // said goodbye, was silent for long, or another run has taken its place
  };
  Kind kind = Kind::kJoined;
  ClientId client;
  Sensor sensor = Sensor::kRgbd;
  bool lockstep = false;  // wants the answer to a keyframe after all that follows from it
};

// Bytes by topic, blobs only, repeats included.
struct Traffic {
  std::uint64_t keyframes = 0, questions = 0;  // from a client
  std::uint64_t map_updates = 0, answers = 0;  // to a client

  std::uint64_t up() const { return keyframes + questions; }
  std::uint64_t down() const { return map_updates + answers; }
};

struct ClientInfo {
  ClientId client;
  Sensor sensor = Sensor::kRgbd;
  bool connected = false;  // heard of within the last seconds
  std::chrono::steady_clock::time_point last_seen;
  std::uint32_t queued = 0;         // keyframes taken in and not done
  std::uint32_t next_sequence = 0;  // keyframes below it are journaled
  std::uint64_t revision = 0;       // of the latest update sent to it
  Traffic traffic{};                // since it joined
  double seconds = 0;               // since then
};

struct IngestStats {
  std::uint64_t accepted = 0;          // journaled and queued
  std::uint64_t duplicates = 0;        // came again; acknowledged again
  std::uint64_t out_of_order = 0;      // had to wait for an earlier one
  std::uint64_t beyond_credits = 0;    // sent without room for them; come again
  std::uint64_t malformed = 0;         // failed the checks; see the log
  std::uint64_t unknown_client = 0;    // of a client that has not said hello (yet)
  std::uint64_t journal_failures = 0;  // not acknowledged; come again
  std::uint64_t refused = 0;           // hellos turned down
  Traffic traffic;                     // of all clients
  std::uint64_t updates = 0;           // published, parts counted singly
  std::uint64_t questions = 0;         // of clients that don't know where they are
  std::uint32_t queued = 0;            // keyframes waiting now
};

struct IngestOptions {
  std::uint32_t domain = 0;
  std::string partition = "cairn";    // the deployment's name
  std::uint32_t queue_capacity = 32;  // keyframes a client run, on their way or being worked on
  MapId map;                          // for the status topic
  std::chrono::milliseconds forget_after{600'000};  // of silence a client counts as gone
  // Called from ingest's thread, one event at a time, from within start() on: must not block.
  // Needed by whoever sends updates.
  std::function<void(const ClientEvent&)> on_event;
  // A client wants to know where `view` lies (RelocaliseAnswer); called likewise. Null: nobody
  // answers.
  std::function<void(const ClientId&, KeyframePtr view)> on_question = {};
  std::string dds_config;  // XML instead of what CYCLONEDDS_URI names
};

class Ingest {
 public:
  // `journal` must outlive this. kUnavailable when DDS does not start.
  static Result<std::unique_ptr<Ingest>> start(const IngestOptions& options, Journal& journal);
  ~Ingest();  // close()
  Ingest(const Ingest&) = delete;
  Ingest& operator=(const Ingest&) = delete;

  // Waits for the next keyframe. Nothing when a stop was asked for, or after close() once all that
  // was taken in has been handed out.
  std::optional<IncomingKeyframe> next(std::stop_token stop = {});
  // Once for each keyframe of next(), when all work on it is done: makes room for another one.
  void done(const ClientId& client);

  // Sends an update to the client, in parts when it is big. Only whether base_revision is 0 (a full
  // refresh) matters here: revisions on the wire count per client and are set by this function.
  // kNotFound: the client is not there any more, which is no error of the caller's.
  Status publish(const ClientId& client, const MapUpdate& update);

  // To a client that has asked; errors as with publish().
  Status answer(const ClientId& client, const RelocaliseAnswer& answer);

  std::vector<ClientInfo> clients() const;  // ascending by id
  IngestStats stats() const;

  // Ends receiving; next() goes on until its queue is empty, publish() until destruction.
  void close();

 private:
  struct Parts;
  explicit Ingest(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace cairn
