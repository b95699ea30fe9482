#include "server/ingest/ingest.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <random>
#include <set>
#include <utility>

#include "common/dds/wait_loop.h"
#include "common/util/log.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/topics.h"
#include "server/ingest/channel.h"
#include "server/ingest/client_table.h"
#include "server/ingest/keyframe_queue.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kHeartbeat{1000};
// Channels of names that nobody uses any more: long enough for a refusal to arrive.
constexpr std::chrono::seconds kChannelRest{10};

std::uint64_t random_instance() {
  std::random_device device;
  const std::uint64_t high = device(), low = device();
  const std::uint64_t value = high << 32 | low;
  return value == 0 ? 1 : value;
}

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

struct ChannelUse {
  std::shared_ptr<Channel> channel;
  Clock::time_point last_use;
};

}  // namespace

struct Ingest::Parts {
  Parts(const IngestOptions& o, Journal& journal, std::shared_ptr<dds::Participant> p,
        wire::Reader<wire::KeyframeMessage> k, wire::Reader<wire::ClientStateMessage> c,
        wire::Reader<wire::RelocaliseRequestMessage> q, wire::Writer<wire::ServerStatusMessage> s)
      : options(o),
        participant(std::move(p)),
        keyframes(std::move(k)),
        states(std::move(c)),
        questions(std::move(q)),
        status(std::move(s)),
        queue(journal, o.queue_capacity, [this] { loop->wake(); }) {}

  const IngestOptions options;
  const std::uint64_t instance = random_instance();
  const Clock::time_point started = Clock::now();
  std::shared_ptr<dds::Participant> participant;
  // The loop's thread only.
  wire::Reader<wire::KeyframeMessage> keyframes;
  wire::Reader<wire::ClientStateMessage> states;
  wire::Reader<wire::RelocaliseRequestMessage> questions;
  wire::Writer<wire::ServerStatusMessage> status;
  Clock::time_point next_status{};

  KeyframeQueue queue;

  mutable std::mutex mutex;  // the rest
  ClientTable table;
  std::map<std::string, ChannelUse> channels;  // by name of the client
  std::uint64_t last_revision = 0;             // of channels that are closed
  std::map<ClientId, std::uint32_t> next_sequences;
  IngestStats counts;

  std::unique_ptr<dds::WaitLoop> loop;  // last: ends before what it uses

  void receive_keyframes();
  void receive_keyframe(const wire::KeyframeMessage& message, std::set<ClientId>& touched);
  void count(KeyframeQueue::Arrival arrival);
  void add(std::uint64_t Traffic::*topic, const ClientId& client, std::uint64_t bytes);
  void receive_questions();
  void receive_question(const wire::RelocaliseRequestMessage& message);
  void receive_states();
  void receive_state(const wire::ClientStateMessage& state);
  std::vector<ChannelUse> close_sessions(const ClientTable::Answer& answer);
  void tell(const std::vector<ClientEvent>& events);
  void say_what_was_sent(const std::vector<ClientTable::Session>& ended) const;
  std::shared_ptr<Channel> channel_of(const std::string& client);
  std::shared_ptr<Channel> open_channel(const ClientId& client);
  void acknowledge(const ClientId& client);
  void refuse(const ClientId& client, const std::string& refusal);
  void tick();
  void rest_channels(Clock::time_point now);
  void send_status();
};

// ---- keyframes

void Ingest::Parts::receive_keyframes() {
  // One acknowledgement a run for all that has come.
  std::set<ClientId> touched;
  const Status s = keyframes.take(
      [&](const wire::KeyframeMessage& message) { receive_keyframe(message, touched); });
  if (!s) log::warn("{}", s.message());
  for (const ClientId& client : touched) acknowledge(client);
}

void Ingest::Parts::receive_keyframe(const wire::KeyframeMessage& message,
                                     std::set<ClientId>& touched) {
  {
    std::lock_guard lock(mutex);
    add(&Traffic::keyframes, message.client, message.blob.size());
    if (table.deliverer(message.client) == nullptr) {
      ++counts.unknown_client;  // its hello is still on the way; the keyframe comes again
      return;
    }
  }
  auto decoded = wire::decode_keyframe(message.blob);
  const bool sound = decoded && decoded->client == message.client &&
                     decoded->keyframe->id.sequence == message.sequence;
  if (!sound) {
    log::warn("client {}: keyframe {} dropped: {}", message.client.name, message.sequence,
              decoded ? "its head and its contents differ" : decoded.message());
    std::lock_guard lock(mutex);
    ++counts.malformed;
    return;
  }
  count(queue.offer(message.client, message.oldest, std::move(decoded->keyframe), message.blob));
  touched.insert(message.client);
}

void Ingest::Parts::count(KeyframeQueue::Arrival arrival) {
  std::lock_guard lock(mutex);
  switch (arrival) {
    case KeyframeQueue::Arrival::kAccepted:
      return;  // the queue counts these: one may release several
    case KeyframeQueue::Arrival::kEarly:
      ++counts.out_of_order;
      return;
    case KeyframeQueue::Arrival::kDuplicate:
      ++counts.duplicates;
      return;
    case KeyframeQueue::Arrival::kBeyond:
      ++counts.beyond_credits;
      return;
    case KeyframeQueue::Arrival::kNotJournaled:
      return;  // the queue counts these
  }
}

// With the mutex held.
void Ingest::Parts::add(std::uint64_t Traffic::*topic, const ClientId& client,
                        std::uint64_t bytes) {
  counts.traffic.*topic += bytes;
  if (ClientTable::Session* session = table.named(client.name)) session->traffic.*topic += bytes;
}

// ---- questions

void Ingest::Parts::receive_questions() {
  const Status s = questions.take(
      [this](const wire::RelocaliseRequestMessage& message) { receive_question(message); });
  if (!s) log::warn("{}", s.message());
}

// One that is not answered comes again, with a newer view.
void Ingest::Parts::receive_question(const wire::RelocaliseRequestMessage& message) {
  {
    std::lock_guard lock(mutex);
    add(&Traffic::questions, message.client, message.blob.size());
    if (table.find(message.client) == nullptr || !options.on_question) return;
  }
  auto decoded = wire::decode_keyframe(message.blob);
  const bool sound = decoded && decoded->client == message.client &&
                     decoded->keyframe->id.sequence == message.number;
  if (!sound)
    log::warn("client {}: question {} dropped: {}", message.client.name, message.number,
              decoded ? "its head and its contents differ" : decoded.message());
  {
    std::lock_guard lock(mutex);
    ++(sound ? counts.questions : counts.malformed);
  }
  if (sound) options.on_question(message.client, std::move(decoded->keyframe));
}

// ---- clients

void Ingest::Parts::receive_states() {
  const Status s =
      states.take([this](const wire::ClientStateMessage& state) { receive_state(state); });
  if (!s) log::warn("{}", s.message());
}

void Ingest::Parts::receive_state(const wire::ClientStateMessage& state) {
  ClientTable::Answer answer;
  std::vector<ChannelUse> closed;  // closes outside of the lock: that can take a moment
  {
    std::lock_guard lock(mutex);
    answer = table.on_state(state, Clock::now());
    if (!answer.refusal.empty()) ++counts.refused;
    closed = close_sessions(answer);
  }
  if (!answer.refusal.empty()) return refuse(state.client, answer.refusal);
  if (!state.leaving) acknowledge(state.client);
  say_what_was_sent(answer.ended);
  tell(answer.events);
}

// With the mutex held. Returns the channels that end with the sessions.
std::vector<ChannelUse> Ingest::Parts::close_sessions(const ClientTable::Answer& answer) {
  std::vector<ChannelUse> closed;
  for (const auto& ended : answer.ended) {
    if (auto node = channels.extract(ended.client.name)) {
      last_revision = std::max(last_revision, node.mapped().channel->last_revision());
      closed.push_back(node.mapped());
    }
    for (const std::uint64_t epoch : ended.runs) {
      next_sequences.erase({ended.client.name, epoch});
      queue.forget({ended.client.name, epoch});
    }
  }
  return closed;
}

void Ingest::Parts::say_what_was_sent(const std::vector<ClientTable::Session>& ended) const {
  for (const ClientTable::Session& session : ended) {
    const double seconds = seconds_between(session.joined, session.last_seen);
    const Traffic& t = session.traffic;
    const auto rate = [&](std::uint64_t bytes) {
      return seconds > 0 ? 1e-3 * static_cast<double>(bytes) / seconds : 0.0;
    };
    log::info(
        "client {} left after {:.1f} s: keyframes {} kB, questions {} kB (up {:.1f} kB/s); map "
        "updates {} kB, answers {} kB (down {:.1f} kB/s)",
        session.client.name, seconds, t.keyframes / 1000, t.questions / 1000, rate(t.up()),
        t.map_updates / 1000, t.answers / 1000, rate(t.down()));
  }
}

void Ingest::Parts::tell(const std::vector<ClientEvent>& events) {
  for (const ClientEvent& event : events) {
    const bool joined = event.kind == ClientEvent::Kind::kJoined;
    if (joined || event.kind == ClientEvent::Kind::kLeft)
      log::debug("client {} {}", event.client.name, joined ? "joined" : "left");
    if (options.on_event) options.on_event(event);
  }
}

std::shared_ptr<Channel> Ingest::Parts::channel_of(const std::string& client) {
  std::lock_guard lock(mutex);
  ChannelUse& use = channels[client];
  use.last_use = Clock::now();
  if (!use.channel) {
    auto channel = Channel::open(participant, options.partition, client, instance, last_revision);
    if (!channel) {
      log::error("{}", channel.message());
      channels.erase(client);
      return nullptr;
    }
    use.channel = std::move(*channel);
  }
  return use.channel;
}

// That of a client that is there; else null.
std::shared_ptr<Channel> Ingest::Parts::open_channel(const ClientId& client) {
  std::lock_guard lock(mutex);
  const auto it = channels.find(client.name);
  if (table.find(client) == nullptr || it == channels.end()) return nullptr;
  return it->second.channel;
}

void Ingest::Parts::acknowledge(const ClientId& client) {
  const KeyframeQueue::Window window = queue.window(client);
  {
    std::lock_guard lock(mutex);
    next_sequences[client] = window.next_sequence;
  }
  const auto channel = channel_of(client.name);
  if (!channel) return;
  const Status s = channel->acknowledge({.client = client,
                                         .server = instance,
                                         .next_sequence = window.next_sequence,
                                         .credits = window.credits,
                                         .published_revision = 0,
                                         .refusal = {}});
  if (!s) log::warn("{}", s.message());
}

void Ingest::Parts::refuse(const ClientId& client, const std::string& refusal) {
  const auto channel = channel_of(client.name);
  if (!channel) return;
  wire::ServerAckMessage ack;
  ack.client = client;
  ack.refusal = refusal;
  if (Status s = channel->acknowledge(std::move(ack)); !s) log::warn("{}", s.message());
}

// ---- time

// Runs every second, and when a run has room again.
void Ingest::Parts::tick() {
  std::vector<ClientId> runs;
  ClientTable::Answer silent;
  std::vector<ChannelUse> closed;  // closes outside of the lock
  const auto now = Clock::now();
  {
    std::lock_guard lock(mutex);
    silent = table.expire(now, options.forget_after);
    closed = close_sessions(silent);
    for (const auto& [name, session] : table.sessions())
      if (session.connected(now))
        for (const std::uint64_t epoch : session.runs) runs.push_back({name, epoch});
    rest_channels(now);
  }
  say_what_was_sent(silent.ended);
  tell(silent.events);
  for (const ClientId& run : runs) acknowledge(run);
  if (now >= next_status) send_status();
}

void Ingest::Parts::rest_channels(Clock::time_point now) {
  std::erase_if(channels, [&](const auto& entry) {
    const auto& [name, use] = entry;
    if (table.sessions().contains(name) || now - use.last_use <= kChannelRest) return false;
    last_revision = std::max(last_revision, use.channel->last_revision());
    return true;
  });
}

void Ingest::Parts::send_status() {
  next_status = Clock::now() + kHeartbeat;
  wire::ServerStatusMessage message;
  const auto now = Clock::now();
  {
    std::lock_guard lock(mutex);
    for (const auto& [name, session] : table.sessions()) message.clients += session.connected(now);
  }
  message.map = options.map;
  message.server = instance;
  message.keyframes = queue.accepted();
  message.uptime_ms = static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::milliseconds>(now - started).count());
  message.queued_keyframes = queue.queued();
  if (Status s = status.write(message); !s) log::warn("{}", s.message());
}

// ---- facade

Ingest::Ingest(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Ingest::~Ingest() {
  close();
}

Result<std::unique_ptr<Ingest>> Ingest::start(const IngestOptions& options, Journal& journal) {
  if (options.queue_capacity == 0)
    return Error{ErrorCode::kInvalidArgument, "ingest: queue without capacity"};
  auto participant = dds::Participant::create({options.domain, options.dds_config});
  if (!participant) return participant.error();
  auto keyframes = wire::Reader<wire::KeyframeMessage>::create(*participant, options.partition);
  if (!keyframes) return keyframes.error();
  auto states = wire::Reader<wire::ClientStateMessage>::create(*participant, options.partition);
  if (!states) return states.error();
  auto questions =
      wire::Reader<wire::RelocaliseRequestMessage>::create(*participant, options.partition);
  if (!questions) return questions.error();
  auto status = wire::Writer<wire::ServerStatusMessage>::create(*participant, options.partition);
  if (!status) return status.error();
  auto parts =
      std::make_unique<Parts>(options, journal, *participant, std::move(*keyframes),
                              std::move(*states), std::move(*questions), std::move(*status));
  Parts* p = parts.get();
  std::vector<dds::WaitLoop::Source> sources = {
      // Hellos first: keyframes of strangers are not taken.
      {p->states.condition(), [p] { p->receive_states(); }},
      {p->keyframes.condition(), [p] { p->receive_keyframes(); }},
      {p->questions.condition(), [p] { p->receive_questions(); }}};
  auto loop =
      dds::WaitLoop::start(*participant, std::move(sources), kHeartbeat, [p] { p->tick(); });
  if (!loop) return loop.error();
  p->loop = std::move(*loop);
  return std::unique_ptr<Ingest>(new Ingest(std::move(parts)));
}

std::optional<IncomingKeyframe> Ingest::next(std::stop_token stop) {
  return parts_->queue.next(stop);
}

void Ingest::done(const ClientId& client) {
  parts_->queue.done(client);
}

Status Ingest::answer(const ClientId& client, const RelocaliseAnswer& answer) {
  const auto channel = parts_->open_channel(client);
  if (!channel) return {ErrorCode::kNotFound, "client " + client.name + " is not there any more"};
  const auto sent = channel->answer(client, answer);
  if (!sent) return sent.error();
  std::lock_guard lock(parts_->mutex);
  parts_->add(&Traffic::answers, client, *sent);
  return {};
}

Status Ingest::publish(const ClientId& client, const MapUpdate& update) {
  const auto channel = parts_->open_channel(client);
  if (!channel) return {ErrorCode::kNotFound, "client " + client.name + " is not there any more"};
  auto published = channel->publish(client, update);
  if (!published) return published.error();
  std::lock_guard lock(parts_->mutex);
  parts_->counts.updates += published->parts;
  parts_->add(&Traffic::map_updates, client, published->bytes);
  return {};
}

std::vector<ClientInfo> Ingest::clients() const {
  std::vector<ClientInfo> infos;
  const auto now = Clock::now();
  std::lock_guard lock(parts_->mutex);
  for (const auto& [name, session] : parts_->table.sessions()) {
    ClientInfo info{.client = session.client,
                    .sensor = session.sensor,
                    .connected = session.connected(now),
                    .last_seen = session.last_seen,
                    .queued = 0,
                    .next_sequence = 0,
                    .revision = 0,
                    .traffic = session.traffic,
                    .seconds = seconds_between(session.joined, now)};
    for (const std::uint64_t epoch : session.runs)
      info.queued += parts_->queue.queued({name, epoch});
    if (const auto it = parts_->next_sequences.find(session.client);
        it != parts_->next_sequences.end())
      info.next_sequence = it->second;
    if (const auto it = parts_->channels.find(name); it != parts_->channels.end())
      info.revision = it->second.channel->revision();
    infos.push_back(std::move(info));
  }
  return infos;
}

IngestStats Ingest::stats() const {
  const std::uint64_t failures = parts_->queue.journal_failures();
  const std::uint64_t accepted = parts_->queue.accepted();
  const std::uint32_t queued = parts_->queue.queued();
  std::lock_guard lock(parts_->mutex);
  IngestStats stats = parts_->counts;
  stats.accepted = accepted;
  stats.journal_failures = failures;
  stats.queued = queued;
  return stats;
}

void Ingest::close() {
  parts_->loop->stop();
  parts_->queue.close();
}

}  // namespace cairn
