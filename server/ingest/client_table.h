// Which clients are there. A name belongs to one run at a time: a second one is refused while the
// first is heard of, and takes its place once it has fallen silent. Knows nothing of DDS.
//
// For one thread at a time.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/wire/topics.h"
#include "server/ingest/ingest.h"

namespace cairn {

class ClientTable {
 public:
  using Clock = std::chrono::steady_clock;
  // Clients say hello every second.
  static constexpr std::chrono::milliseconds kSilence{3000};
  static constexpr std::size_t kMaxClients = 256;
  // Runs of one client that can have keyframes in its outbox.
  static constexpr std::size_t kMaxRuns = 64;

  struct Session {
    ClientId client;
    Sensor sensor = Sensor::kRgbd;
    Clock::time_point last_seen;
    std::uint32_t refresh_requests = 0;
    bool finishing = false;
    Clock::time_point joined;
    Traffic traffic;
    std::set<std::uint64_t> runs;  // epochs that keyframes have come from, its own included

    bool connected(Clock::time_point now) const { return now - last_seen < kSilence; }
  };
  struct Answer {
    std::string refusal;              // not empty: the client is turned away
    std::vector<ClientEvent> events;  // in this order
    std::vector<Session> ended;
  };

  Answer on_state(const wire::ClientStateMessage& state, Clock::time_point now);
  // Ends the sessions that have been silent for so long.
  Answer expire(Clock::time_point now, std::chrono::milliseconds silence);
  // The session that may deliver keyframes of `client`, which can be an earlier run of it; null
  // when there is none.
  Session* deliverer(const ClientId& client);
  // The session of the client that is there under that name, whichever run of it.
  Session* named(const std::string& name);
  const Session* find(const ClientId& client) const;
  const std::map<std::string, Session>& sessions() const { return sessions_; }

 private:
  Answer leave(const wire::ClientStateMessage& state, Clock::time_point now);
  Answer join(const wire::ClientStateMessage& state, Clock::time_point now);

  std::map<std::string, Session> sessions_;  // by name
};

}  // namespace cairn
