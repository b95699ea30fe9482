// What the server keeps for one run of a client: its local mapping, and what it has been told.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "common/util/status.h"
#include "server/map/map_writer.h"
#include "server/mapping/local_mapping.h"
#include "server/publish/publish.h"

namespace cairn {

// The FairQueue gives out one job of a client at a time; whoever has it uses the client's desk.
class ClientDesk {
 public:
  // `writer` must outlive this.
  ClientDesk(const ClientId& client, MapWriter& writer, const LocalMappingOptions& options = {},
             const PublishOptions& publish = {});

  // Local mapping of a keyframe of this client, up to the solve.
  LocalMappingReport extend(KeyframeId id, std::size_t waiting = 0) {
    return mapping_.extend(id, waiting);
  }

  // Sends what the client has not been told yet, if anything, or all anew when it wants a refresh.
  // What `send` refuses the client has not heard of: the next time starts over.
  // `settled`: see ClientView::difference().
  Status tell(const Map& map, bool settled, const std::function<Status(const MapUpdate&)>& send);

  // From any thread: the client has missed something, tell it everything anew.
  void refresh() { wants_refresh_ = true; }

  // From any thread: whether a job without a keyframe waits for this desk; one at a time is enough.
  std::atomic<bool> event_waits = false;
  // The client wants the answer to a keyframe after all that follows from it.
  std::atomic<bool> lockstep = false;

 private:
  const std::uint64_t epoch_;
  LocalMapping mapping_;
  ClientView view_;
  std::atomic<bool> wants_refresh_ = false;
};

// The desks in use. A client that is there has one; a run that is not, for as long as there is work
// on its keyframes. All members are safe from any thread.
class ClientDesks {
 public:
  using Make = std::function<std::shared_ptr<ClientDesk>(const ClientId&)>;
  explicit ClientDesks(Make make) : make_(std::move(make)) {}

  // The desk, made when there is none.
  std::shared_ptr<ClientDesk> of(const ClientId& client);
  // The client is there: its desk stays until leave() and then release().
  std::shared_ptr<ClientDesk> join(const ClientId& client);
  // Null when it has none.
  std::shared_ptr<ClientDesk> leave(const ClientId& client);
  bool is_there(const ClientId& client) const;
  // Frees the desk of a run that is not there. By whoever has the client's job, when none follows.
  void release(const ClientId& client);
  std::size_t size() const;
  // The runs that are there.
  std::vector<ClientId> present() const;

 private:
  struct Entry {
    std::shared_ptr<ClientDesk> desk;
    bool is_there = false;
  };
  Entry& entry(const ClientId& client);  // with mutex_ held

  const Make make_;
  mutable std::mutex mutex_;
  std::map<ClientId, Entry> entries_;
};

}  // namespace cairn
