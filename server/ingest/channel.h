// What the server sends to the clients of one name: acknowledgements, map updates, and where a lost
// one is.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "common/model/map_update.h"
#include "common/model/relocalise.h"
#include "common/wire/topics.h"

namespace cairn {

// Safe from any thread.
class Channel {
 public:
  struct Published {
    std::uint32_t parts = 0;
    std::uint64_t bytes = 0;
  };

  // `server`: this server's instance. `last_revision`: the newest that it has used for any client,
  // so that one who comes back after its channel was closed takes what is sent for new.
  static Result<std::shared_ptr<Channel>> open(std::shared_ptr<dds::Participant> participant,
                                               const std::string& deployment,
                                               const std::string& client, std::uint64_t server,
                                               std::uint64_t last_revision = 0);

  // Adds the revision published so far and the server's instance.
  Status acknowledge(wire::ServerAckMessage ack);
  // Numbers the revisions, cuts the update into parts and sends them; all or none.
  Result<Published> publish(const ClientId& client, MapUpdate update);
  std::uint64_t revision() const;       // published last; 0 before the first
  std::uint64_t last_revision() const;  // used so far, by channels before this one too
  // Bytes sent.
  Result<std::uint64_t> answer(const ClientId& client, const RelocaliseAnswer& answer);

 private:
  // A client that knows nothing is at 0. Starting at 1 makes a first update that is not a full
  // refresh look like what it is, a gap.
  static constexpr std::uint64_t kFirstRevision = 1;

  Channel(std::uint64_t server, std::uint64_t last_revision,
          wire::Writer<wire::ServerAckMessage> acks, wire::Writer<wire::MapUpdateMessage> updates,
          wire::Writer<wire::RelocaliseAnswerMessage> answers)
      : server_(server),
        acks_(std::move(acks)),
        updates_(std::move(updates)),
        answers_(std::move(answers)),
        revision_(std::max(last_revision, kFirstRevision)) {}

  const std::uint64_t server_;
  wire::Writer<wire::ServerAckMessage> acks_;
  wire::Writer<wire::MapUpdateMessage> updates_;
  wire::Writer<wire::RelocaliseAnswerMessage> answers_;
  std::mutex publishing_;  // keeps the parts of one update together
  mutable std::mutex mutex_;
  std::uint64_t revision_;
  bool published_ = false;
};

}  // namespace cairn
