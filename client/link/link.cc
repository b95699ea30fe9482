#include "client/link/link.h"

#include <utility>
#include <vector>

#include "client/link/downlink.h"
#include "client/link/inquiry.h"
#include "client/link/outbox.h"
#include "client/link/uplink.h"
#include "common/dds/wait_loop.h"
#include "common/util/log.h"
#include "common/wire/keyframe_codec.h"

namespace cairn {
namespace {

// The DDS entities of a client; none of them without a server.
struct Connection {
  wire::Writer<wire::KeyframeMessage> keyframes;
  wire::Writer<wire::ClientStateMessage> states;
  wire::Reader<wire::ServerAckMessage> acks;
  wire::Reader<wire::MapUpdateMessage> updates;
  wire::Writer<wire::RelocaliseRequestMessage> questions;
  wire::Reader<wire::RelocaliseAnswerMessage> answers;
  std::shared_ptr<dds::Participant> participant;
};

Result<std::unique_ptr<Connection>> connect(const LinkOptions& options) {
  auto participant = dds::Participant::create({options.domain, options.dds_config});
  if (!participant) return participant.error();
  const std::string own = wire::client_partition(options.partition, options.client.name);
  auto keyframes = wire::Writer<wire::KeyframeMessage>::create(*participant, options.partition);
  if (!keyframes) return keyframes.error();
  auto states = wire::Writer<wire::ClientStateMessage>::create(*participant, options.partition);
  if (!states) return states.error();
  auto acks = wire::Reader<wire::ServerAckMessage>::create(*participant, own);
  if (!acks) return acks.error();
  auto updates = wire::Reader<wire::MapUpdateMessage>::create(*participant, own);
  if (!updates) return updates.error();
  auto questions =
      wire::Writer<wire::RelocaliseRequestMessage>::create(*participant, options.partition);
  if (!questions) return questions.error();
  auto answers = wire::Reader<wire::RelocaliseAnswerMessage>::create(*participant, own);
  if (!answers) return answers.error();
  return std::make_unique<Connection>(
      Connection{std::move(*keyframes), std::move(*states), std::move(*acks), std::move(*updates),
                 std::move(*questions), std::move(*answers), std::move(*participant)});
}

}  // namespace

// Threads: the uplink's, and the loop's for receiving. Destroyed in reverse: the loop first, since
// it calls the others, and the connection last.
struct Link::Parts {
  std::unique_ptr<Connection> connection;
  std::unique_ptr<Uplink> uplink;
  std::unique_ptr<Downlink> downlink;
  std::unique_ptr<Inquiry> inquiry;  // null without a server
  std::unique_ptr<dds::WaitLoop> loop;

  void receive_acks() {
    const Status s = connection->acks.take([this](const wire::ServerAckMessage& ack) {
      uplink->on_ack(ack);
      downlink->on_ack(ack, Downlink::Clock::now());
    });
    if (!s) log::warn("{}", s.message());
  }
  void receive_updates() {
    const Status s = connection->updates.take(
        [this](const wire::MapUpdateMessage& update) { downlink->receive(update); });
    if (!s) log::warn("{}", s.message());
  }
  void receive_answers() {
    const Status s = connection->answers.take(
        [this](const wire::RelocaliseAnswerMessage& answer) { inquiry->receive(answer); });
    if (!s) log::warn("{}", s.message());
  }
  // Questions go out from the receiving thread: the uplink's may be waiting for room, and a write
  // of theirs never does.
  void start_inquiry(const ClientId& client) {
    inquiry = std::make_unique<Inquiry>(
        client, [c = connection.get()](const auto& message) { return c->questions.write(message); },
        [this] { loop->wake(); });
  }
  Uplink::Port port() {
    if (!connection) return {};
    return {.send_keyframe =
                [c = connection.get()](const auto& message) { return c->keyframes.write(message); },
            .send_state =
                [c = connection.get()](const auto& message) {
                  Status s = c->states.write(message);
                  // Goodbye is the last word: give it a moment to arrive.
                  if (s && message.leaving)
                    (void)c->states.flush(std::chrono::milliseconds(200)).ok();
                  return s;
                }};
  }
};

Link::Link(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Link::~Link() {
  stop();
}

Result<std::unique_ptr<Link>> Link::start(const LinkOptions& options) {
  if (Status s = wire::check_client_name(options.client.name); !s) return s.error();
  if (options.client.epoch == 0)
    return Error{ErrorCode::kInvalidArgument, "client without an epoch"};
  auto outbox = Outbox::open(options.outbox, options.client.name);
  if (!outbox) return outbox.error();

  auto parts = std::make_unique<Parts>();
  Parts* p = parts.get();
  if (!options.no_server) {
    auto connection = connect(options);
    if (!connection) return connection.error();
    p->connection = std::move(*connection);
  }
  p->uplink = std::make_unique<Uplink>(options.client, options.sensor, std::move(*outbox),
                                       p->port(), Uplink::Timing{.lockstep = options.lockstep});
  p->downlink = std::make_unique<Downlink>(options.client, [p] { p->uplink->request_refresh(); });
  if (p->connection) {
    p->start_inquiry(options.client);
    std::vector<dds::WaitLoop::Source> sources = {
        {p->connection->acks.condition(), [p] { p->receive_acks(); }},
        {p->connection->updates.condition(), [p] { p->receive_updates(); }},
        {p->connection->answers.condition(), [p] { p->receive_answers(); }}};
    auto loop = dds::WaitLoop::start(p->connection->participant, std::move(sources),
                                     std::chrono::hours(1), [p] { p->inquiry->send_waiting(); });
    if (!loop) return loop.error();
    p->loop = std::move(*loop);
  }
  return std::unique_ptr<Link>(new Link(std::move(parts)));
}

void Link::send(KeyframePtr keyframe) {
  parts_->uplink->send(std::move(keyframe));
}
std::optional<MapUpdate> Link::poll_update() {
  return parts_->downlink->poll();
}
std::optional<MapUpdate> Link::wait_update(std::chrono::nanoseconds timeout, std::stop_token stop) {
  return parts_->downlink->wait(timeout, std::move(stop));
}
Status Link::status() const {
  return parts_->uplink->status();
}
bool Link::wait_delivered(std::chrono::nanoseconds timeout, std::stop_token stop) {
  return parts_->uplink->wait_delivered(timeout, std::move(stop));
}

void Link::say_finishing() {
  parts_->uplink->say_finishing();
}

void Link::ask(KeyframePtr view) {
  if (parts_->inquiry) parts_->inquiry->ask(std::move(view));
}
std::optional<RelocaliseAnswer> Link::poll_answer() {
  return parts_->inquiry ? parts_->inquiry->poll() : std::nullopt;
}
std::optional<RelocaliseAnswer> Link::wait_answer(std::chrono::nanoseconds timeout,
                                                  std::stop_token stop) {
  return parts_->inquiry ? parts_->inquiry->wait(timeout, std::move(stop)) : std::nullopt;
}

LinkStats Link::stats() const {
  const Uplink::Stats up = parts_->uplink->stats();
  const Downlink::Stats down = parts_->downlink->stats();
  const Inquiry::Stats asked = parts_->inquiry ? parts_->inquiry->stats() : Inquiry::Stats{};
  return {.connected = up.connected,
          .heard = up.heard,
          .keyframes_made = up.made,
          .keyframes_acked = up.acked,
          .keyframes_in_outbox = up.waiting,
          .bytes_up = up.bytes + asked.bytes_up,
          .bytes_down = down.bytes + asked.bytes_down,
          .resends = up.resends,
          .updates = down.updates,
          .refreshes_asked = up.refresh_requests,
          .questions = asked.asked};
}

void Link::stop() {
  parts_->uplink->stop();
  if (parts_->loop) parts_->loop->stop();
}

}  // namespace cairn
