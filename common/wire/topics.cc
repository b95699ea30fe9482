#include "common/wire/topics.h"

#include <algorithm>
#include <cstring>

#include "common/wire/keyframe_codec.h"
#include "control.h"
#include "keyframe.h"
#include "map_update.h"
#include "relocalise.h"
#include "status.h"

namespace cairn::wire {
namespace {

// For each message: the struct that idlc makes of it, its topic, and the way there and back. `to`
// borrows the message's blob; `from` tells whether the sample is one.
template <typename Message>
struct Mapping;

template <std::size_t N>
void put_text(char (&to)[N], std::string_view from) {
  const std::size_t length = std::min(from.size(), N - 1);
  std::memcpy(to, from.data(), length);
  to[length] = '\0';
}

template <std::size_t N>
std::string get_text(const char (&from)[N]) {
  return std::string(from, strnlen(from, N));
}

template <typename Sample>
void put_client(Sample& sample, const ClientId& client) {
  put_text(sample.client, client.name);
  sample.epoch = client.epoch;
}

template <typename Sample>
bool get_client(const Sample& sample, ClientId& client) {
  client = {get_text(sample.client), sample.epoch};
  return client.epoch != 0 && check_client_name(client.name).ok();
}

template <typename Sequence>
void put_blob(Sequence& sequence, Bytes blob) {
  // Cyclone only reads it; the C struct has no const.
  sequence._buffer = const_cast<std::uint8_t*>(blob.data());
  sequence._length = sequence._maximum = static_cast<std::uint32_t>(blob.size());
  sequence._release = false;
}

template <typename Sequence>
Bytes get_blob(const Sequence& sequence) {
  return sequence._buffer == nullptr ? Bytes{} : Bytes(sequence._buffer, sequence._length);
}

template <>
struct Mapping<KeyframeMessage> {
  using Sample = cairn_wire_KeyframeSample;
  static dds::TopicType topic() {
    return {"cairn_keyframe_v2", &cairn_wire_KeyframeSample_desc, dds::Quality::kStream};
  }
  static void to(const KeyframeMessage& m, Sample& s) {
    put_client(s, m.client);
    s.number = m.sequence;
    s.oldest = m.oldest;
    put_blob(s.blob, m.blob);
  }
  static bool from(const Sample& s, KeyframeMessage& m) {
    m.sequence = s.number;
    m.oldest = s.oldest;
    m.blob = get_blob(s.blob);
    return get_client(s, m.client) && m.oldest <= m.sequence;
  }
};

template <>
struct Mapping<MapUpdateMessage> {
  using Sample = cairn_wire_MapUpdateSample;
  static dds::TopicType topic() {
    return {"cairn_map_update_v2", &cairn_wire_MapUpdateSample_desc, dds::Quality::kHistory};
  }
  static void to(const MapUpdateMessage& m, Sample& s) {
    put_client(s, m.client);
    s.server = m.server;
    s.base_revision = m.base_revision;
    s.revision = m.revision;
    s.last_part = m.last_part;
    put_blob(s.blob, m.blob);
  }
  static bool from(const Sample& s, MapUpdateMessage& m) {
    m.server = s.server;
    m.base_revision = s.base_revision;
    m.revision = s.revision;
    m.last_part = s.last_part;
    m.blob = get_blob(s.blob);
    return get_client(s, m.client) && m.revision > m.base_revision;
  }
};

template <>
struct Mapping<ClientStateMessage> {
  using Sample = cairn_wire_ClientState;
  static dds::TopicType topic() {
    return {"cairn_client_state_v1", &cairn_wire_ClientState_desc, dds::Quality::kState};
  }
  static void to(const ClientStateMessage& m, Sample& s) {
    put_client(s, m.client);
    s.protocol = m.protocol;
    s.sensor = static_cast<std::uint8_t>(m.sensor);
    s.refresh_requests = m.refresh_requests;
    s.lockstep = m.lockstep;
    s.finishing = m.finishing;
    s.leaving = m.leaving;
  }
  static bool from(const Sample& s, ClientStateMessage& m) {
    m.protocol = s.protocol;
    m.sensor = static_cast<Sensor>(s.sensor);
    m.refresh_requests = s.refresh_requests;
    m.lockstep = s.lockstep;
    m.finishing = s.finishing;
    m.leaving = s.leaving;
    // A later protocol may know more sensors; that client is refused in words.
    return get_client(s, m.client) && (m.sensor <= Sensor::kMono || m.protocol != kProtocol);
  }
};

template <>
struct Mapping<ServerAckMessage> {
  using Sample = cairn_wire_ServerAck;
  static dds::TopicType topic() {
    return {"cairn_server_ack_v1", &cairn_wire_ServerAck_desc, dds::Quality::kState};
  }
  static void to(const ServerAckMessage& m, Sample& s) {
    put_client(s, m.client);
    s.server = m.server;
    s.next_sequence = m.next_sequence;
    s.credits = m.credits;
    s.published_revision = m.published_revision;
    put_text(s.refusal, m.refusal);
  }
  static bool from(const Sample& s, ServerAckMessage& m) {
    m.server = s.server;
    m.next_sequence = s.next_sequence;
    m.credits = s.credits;
    m.published_revision = s.published_revision;
    m.refusal = get_text(s.refusal);
    return get_client(s, m.client);
  }
};

template <>
struct Mapping<RelocaliseRequestMessage> {
  using Sample = cairn_wire_RelocaliseRequest;
  static dds::TopicType topic() {
    return {"cairn_relocalise_request_v1", &cairn_wire_RelocaliseRequest_desc,
            dds::Quality::kLatest};
  }
  static void to(const RelocaliseRequestMessage& m, Sample& s) {
    put_client(s, m.client);
    s.number = m.number;
    put_blob(s.blob, m.blob);
  }
  static bool from(const Sample& s, RelocaliseRequestMessage& m) {
    m.number = s.number;
    m.blob = get_blob(s.blob);
    return get_client(s, m.client);
  }
};

template <>
struct Mapping<RelocaliseAnswerMessage> {
  using Sample = cairn_wire_RelocaliseAnswer;
  static dds::TopicType topic() {
    return {"cairn_relocalise_answer_v1", &cairn_wire_RelocaliseAnswer_desc, dds::Quality::kLatest};
  }
  static void to(const RelocaliseAnswerMessage& m, Sample& s) {
    put_client(s, m.client);
    s.number = m.number;
    put_blob(s.blob, m.blob);
  }
  static bool from(const Sample& s, RelocaliseAnswerMessage& m) {
    m.number = s.number;
    m.blob = get_blob(s.blob);
    return get_client(s, m.client);
  }
};

template <>
struct Mapping<ServerStatusMessage> {
  using Sample = cairn_wire_ServerStatus;
  static dds::TopicType topic() {
    return {"cairn_server_status_v1", &cairn_wire_ServerStatus_desc, dds::Quality::kState};
  }
  static void to(const ServerStatusMessage& m, Sample& s) {
    s.server = m.server;
    s.protocol = m.protocol;
    s.map_id = m.map.value;
    s.uptime_ms = m.uptime_ms;
    s.clients = m.clients;
    s.keyframes = m.keyframes;
    s.queued_keyframes = m.queued_keyframes;
  }
  static bool from(const Sample& s, ServerStatusMessage& m) {
    m = {s.server,  s.protocol,  MapId{s.map_id},   s.uptime_ms,
         s.clients, s.keyframes, s.queued_keyframes};
    return true;
  }
};

}  // namespace

std::string client_partition(const std::string& deployment, std::string_view client) {
  return deployment + "/" + std::string(client);
}

template <typename Message>
Result<Writer<Message>> Writer<Message>::create(std::shared_ptr<dds::Participant> participant,
                                                const std::string& partition) {
  auto samples =
      dds::SampleWriter::create(std::move(participant), Mapping<Message>::topic(), partition);
  if (!samples) return samples.error();
  return Writer(std::move(*samples));
}

template <typename Message>
Status Writer<Message>::write(const Message& message) {
  typename Mapping<Message>::Sample sample{};
  Mapping<Message>::to(message, sample);
  return samples_.write(&sample);
}

template <typename Message>
Result<Reader<Message>> Reader<Message>::create(std::shared_ptr<dds::Participant> participant,
                                                const std::string& partition) {
  auto samples =
      dds::SampleReader::create(std::move(participant), Mapping<Message>::topic(), partition);
  if (!samples) return samples.error();
  return Reader(std::move(*samples));
}

template <typename Message>
Status Reader<Message>::take(const std::function<void(const Message&)>& on_message) {
  const auto taken = samples_.take([&](const void* raw) {
    Message message;
    if (Mapping<Message>::from(*static_cast<const typename Mapping<Message>::Sample*>(raw),
                               message))
      on_message(message);
    else
      ++malformed_;
  });
  return taken ? Status() : Status(taken.error());
}

template class Writer<KeyframeMessage>;
template class Reader<KeyframeMessage>;
template class Writer<MapUpdateMessage>;
template class Reader<MapUpdateMessage>;
template class Writer<ClientStateMessage>;
template class Reader<ClientStateMessage>;
template class Writer<ServerAckMessage>;
template class Reader<ServerAckMessage>;
template class Writer<RelocaliseRequestMessage>;
template class Reader<RelocaliseRequestMessage>;
template class Writer<RelocaliseAnswerMessage>;
template class Reader<RelocaliseAnswerMessage>;
template class Writer<ServerStatusMessage>;
template class Reader<ServerStatusMessage>;

}  // namespace cairn::wire
