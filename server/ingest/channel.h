// What the server sends to the clients of one name: acknowledgements, map updates, and where a lost
// one is.
#pragma once

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

  // `server`: this server's instance.
  static Result<std::shared_ptr<Channel>> open(std::shared_ptr<dds::Participant> participant,
                                               const std::string& deployment,
                                               const std::string& client, std::uint64_t server);

  // Adds the revision published so far and the server's instance.
  Status acknowledge(wire::ServerAckMessage ack);
  // Numbers the revisions, cuts the update into parts and sends them; all or none.
  Result<Published> publish(const ClientId& client, MapUpdate update);
  std::uint64_t revision() const;
  // Bytes sent.
  Result<std::uint64_t> answer(const ClientId& client, const RelocaliseAnswer& answer);

 private:
  Channel(std::uint64_t server, wire::Writer<wire::ServerAckMessage> acks,
          wire::Writer<wire::MapUpdateMessage> updates,
          wire::Writer<wire::RelocaliseAnswerMessage> answers)
      : server_(server),
        acks_(std::move(acks)),
        updates_(std::move(updates)),
        answers_(std::move(answers)) {}

  const std::uint64_t server_;
  wire::Writer<wire::ServerAckMessage> acks_;
  wire::Writer<wire::MapUpdateMessage> updates_;
  wire::Writer<wire::RelocaliseAnswerMessage> answers_;
  std::mutex publishing_;  // keeps the parts of one update together
  mutable std::mutex mutex_;
  // A client that knows nothing is at 0. Starting at 1 makes a first update that is not a full
  // refresh look like what it is, a gap.
  std::uint64_t revision_ = 1;
  bool published_ = false;
};

}  // namespace cairn
