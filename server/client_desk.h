// What the server keeps for one run of a client: its local mapping, and what it has been told.
#pragma once

#include <atomic>
#include <cstdint>

#include "common/model/ids.h"
#include "server/map/map_writer.h"
#include "server/mapping/local_mapping.h"
#include "server/publish/publish.h"

namespace cairn {

// The FairQueue gives out one job of a client at a time; whoever has it uses the client's desk.
class ClientDesk {
 public:
  ClientDesk(const ClientId& client, MapWriter& writer, const LocalSolver& solver,
             const LocalMappingOptions& options)
      : mapping(writer, solver, options), view(client.epoch) {}

  LocalMapping mapping;
  ClientView view;
  std::uint32_t mapped_keyframes = 0;  // 0 .. mapped_keyframes-1 have been through mapping
  // From any thread: the client has missed something, tell it everything anew.
  std::atomic<bool> wants_refresh = false;
};

}  // namespace cairn
