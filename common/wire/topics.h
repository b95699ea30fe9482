// The topics between client and server, as plain structs with a typed writer and reader each.
//
// Partitions: everything from clients and the server's status is in the deployment's partition;
// what the server sends to one client in that client's own (client_partition), so that clients
// receive nothing that is meant for others.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "common/dds/endpoint.h"
#include "common/model/ids.h"
#include "common/model/keyframe.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

// Counts changes of what the messages mean; the names of topics end in it. The control topics stay
// at v1, so that programs of different versions can tell each other that they don't fit.
inline constexpr std::uint32_t kProtocol = 3;

std::string client_partition(const std::string& deployment, std::string_view client);

// The IDL files say what the members mean.
struct KeyframeMessage {
  ClientId client;
  std::uint32_t sequence = 0;
  std::uint32_t oldest = 0;
  Bytes blob;  // when received: lent until the callback returns
};

struct MapUpdateMessage {
  ClientId client;
  std::uint64_t server = 0;
  std::uint64_t base_revision = 0;
  std::uint64_t revision = 0;
  bool last_part = true;
  Bytes blob;  // when received: lent until the callback returns
};

struct ClientStateMessage {
  ClientId client;
  std::uint32_t protocol = kProtocol;
  Sensor sensor = Sensor::kRgbd;
  std::uint32_t refresh_requests = 0;
  bool lockstep = false;
  bool finishing = false;
  bool leaving = false;
};

struct ServerAckMessage {
  ClientId client;
  std::uint64_t server = 0;
  std::uint32_t next_sequence = 0;
  std::uint32_t credits = 0;
  std::uint64_t published_revision = 0;
  std::string refusal;  // cut to 255 bytes
};

struct RelocaliseRequestMessage {
  ClientId client;
  std::uint32_t number = 0;
  Bytes blob;  // when received: lent until the callback returns
};

struct RelocaliseAnswerMessage {
  ClientId client;
  std::uint32_t number = 0;
  Bytes blob;  // when received: lent until the callback returns
};

struct ServerStatusMessage {
  std::uint64_t server = 0;
  std::uint32_t protocol = kProtocol;
  MapId map;
  std::uint64_t uptime_ms = 0;
  std::uint32_t clients = 0;
  std::uint64_t keyframes = 0;
  std::uint32_t queued_keyframes = 0;
};

// Safe from any thread.
template <typename Message>
class Writer {
 public:
  static Result<Writer> create(std::shared_ptr<dds::Participant> participant,
                               const std::string& partition);
  // kTimeout for keyframes when there is no room: not sent, write again.
  Status write(const Message& message);
  // Waits until all present readers have everything.
  Status flush(std::chrono::nanoseconds timeout) { return samples_.flush(timeout); }
  int matched_readers() const { return samples_.matched_readers(); }

 private:
  explicit Writer(dds::SampleWriter samples) : samples_(std::move(samples)) {}
  dds::SampleWriter samples_;
};

// For one thread at a time.
template <typename Message>
class Reader {
 public:
  static Result<Reader> create(std::shared_ptr<dds::Participant> participant,
                               const std::string& partition);
  // Calls back for each message that has arrived. Messages with an impossible client or field are
  // left out and counted.
  Status take(const std::function<void(const Message&)>& on_message);
  std::uint64_t malformed() const { return malformed_; }
  std::int32_t condition() const { return samples_.condition(); }
  int matched_writers() const { return samples_.matched_writers(); }

 private:
  explicit Reader(dds::SampleReader samples) : samples_(std::move(samples)) {}
  dds::SampleReader samples_;
  std::uint64_t malformed_ = 0;
};

}  // namespace cairn::wire
