#include "client/link/uplink.h"

#include <algorithm>
#include <utility>

#include "common/util/log.h"
#include "common/util/thread.h"
#include "common/wire/keyframe_codec.h"

namespace cairn {
namespace {

// Keyframes of a run that are sent before the server has said how many it takes.
constexpr std::uint32_t kFirstCredits = 4;

}  // namespace

Uplink::Uplink(ClientId client, Sensor sensor, std::unique_ptr<Outbox> outbox, Port port,
               Timing timing)
    : client_(std::move(client)),
      sensor_(sensor),
      port_(std::move(port)),
      timing_(timing),
      outbox_(std::move(outbox)),
      resend_after_(timing.resend) {
  stats_.waiting = outbox_->waiting().size();
  thread_ = std::jthread([this](std::stop_token stop) {
    name_this_thread("uplink");
    run(stop);
  });
}

Uplink::~Uplink() {
  stop();
}

void Uplink::send(KeyframePtr keyframe) {
  {
    std::lock_guard lock(mutex_);
    inbox_.keyframes.push_back(std::move(keyframe));
    ++stats_.made;
    ++stats_.waiting;
  }
  changed_.notify_all();
}

void Uplink::on_ack(const wire::ServerAckMessage& ack) {
  {
    std::lock_guard lock(mutex_);
    inbox_.acks.push_back(ack);
  }
  changed_.notify_all();
}

void Uplink::say_finishing() {
  {
    std::lock_guard lock(mutex_);
    finishing_ = true;
    inbox_.wake = true;
  }
  changed_.notify_all();
}

void Uplink::request_refresh() {
  {
    std::lock_guard lock(mutex_);
    ++stats_.refresh_requests;
    inbox_.wake = true;
  }
  changed_.notify_all();
}

bool Uplink::connected_at(Clock::time_point now) const {
  return accepted_ && now - heard_ < timing_.silence;
}

Uplink::Stats Uplink::stats() const {
  std::lock_guard lock(mutex_);
  Stats stats = stats_;
  stats.connected = connected_at(Clock::now());
  stats.heard = heard_;
  return stats;
}

Status Uplink::status() const {
  std::lock_guard lock(mutex_);
  return status_;
}

bool Uplink::wait_delivered(std::chrono::nanoseconds timeout, std::stop_token stop) {
  std::unique_lock lock(mutex_);
  const auto ended = [&] { return stats_.waiting == 0 || !status_.ok(); };
  if (port_.send_keyframe) delivered_.wait_for(lock, stop, timeout, ended);
  return stats_.waiting == 0;
}

void Uplink::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
}

void Uplink::fail(const Error& error) {
  log::error("{}", error.message);
  {
    std::lock_guard lock(mutex_);
    if (status_.ok()) status_ = error;
  }
  delivered_.notify_all();
}

void Uplink::run(std::stop_token stop) {
  while (true) {
    const Inbox inbox = wait_for_work(stop);
    store(inbox.keyframes);
    if (port_.send_keyframe) {
      for (const auto& ack : inbox.acks) handle(ack);
      if (inbox.wake || Clock::now() >= next_heartbeat_) send_state(false);
      resend_if_stuck();
      send_window(stop);
    }
    std::lock_guard lock(mutex_);
    if (stop.stop_requested() && inbox_.keyframes.empty()) break;
  }
  if (port_.send_state) send_state(true);
  if (outbox_->waiting().empty() && !outbox_broken_) outbox_->remove_file();
  outbox_.reset();  // the file is free for others from here on
}

Uplink::Inbox Uplink::wait_for_work(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  const auto ready = [&] { return !inbox_.empty(); };
  if (!port_.send_keyframe) {
    changed_.wait(lock, stop, ready);
  } else {
    Clock::time_point deadline = next_heartbeat_;
    if (sent_ > 0) deadline = std::min(deadline, progress_ + resend_after_);
    if (retry_at_ != Clock::time_point{}) deadline = std::min(deadline, retry_at_);
    changed_.wait_until(lock, stop, deadline, ready);
  }
  return std::exchange(inbox_, {});
}

void Uplink::store(const std::vector<KeyframePtr>& keyframes) {
  for (const KeyframePtr& keyframe : keyframes) {
    // A keyframe that cannot be stored leaves a gap that the server would wait for; after the first
    // failure the rest would do no good either.
    if (outbox_broken_) return;
    auto blob = wire::encode_keyframe(client_.name, *keyframe);
    const Status s = blob ? outbox_->put(keyframe->id, *blob) : Status(blob.error());
    if (!s) {
      outbox_broken_ = true;
      fail(s.error());
    }
  }
}

void Uplink::handle(const wire::ServerAckMessage& ack) {
  if (ack.client.name != client_.name) return;
  if (!ack.refusal.empty()) {
    if (ack.client.epoch == client_.epoch) handle_refusal(ack.refusal);
    return;
  }
  if (ack.client.epoch == client_.epoch) greet_server(ack.server);
  windows_[ack.client.epoch] = {ack.next_sequence, ack.credits};

  const std::size_t before = outbox_->waiting().size();
  if (Status s = outbox_->remove_before(ack.client.epoch, ack.next_sequence); !s)
    return fail(s.error());
  const std::size_t removed = before - outbox_->waiting().size();
  if (removed == 0) return;
  if (ack.client.epoch == stream_) sent_ -= std::min(sent_, removed);
  progress_ = Clock::now();
  resend_after_ = timing_.resend;
  {
    std::lock_guard lock(mutex_);
    stats_.acked += removed;
    stats_.waiting -= removed;
  }
  delivered_.notify_all();
}

void Uplink::handle_refusal(const std::string& refusal) {
  const auto now = Clock::now();
  if (refused_since_ == Clock::time_point{}) {
    refused_since_ = now;
    log::warn("the server refuses this client for now: {}", refusal);
  }
  {
    std::lock_guard lock(mutex_);
    accepted_ = false;
  }
  if (now - refused_since_ > timing_.refusal_patience && status().ok())
    fail({ErrorCode::kUnavailable, "the server refuses client '" + client_.name + "': " + refusal});
}

void Uplink::greet_server(std::uint64_t server) {
  const auto now = Clock::now();
  refused_since_ = {};
  bool back = false;
  {
    std::lock_guard lock(mutex_);
    back = !connected_at(now);
    accepted_ = true;
    heard_ = now;
  }
  if (!back && server == server_) return;
  log::info("{} the server", server == server_ ? "again in touch with" : "connected to");
  if (server != server_) windows_.clear();
  server_ = server;
  // What was on its way when the link broke may never have arrived.
  sent_ = 0;
  resend_after_ = timing_.resend;
}

void Uplink::send_state(bool leaving) {
  wire::ClientStateMessage state{.client = client_,
                                 .protocol = wire::kProtocol,
                                 .sensor = sensor_,
                                 .refresh_requests = 0,
                                 .lockstep = timing_.lockstep,
                                 .finishing = false,
                                 .leaving = leaving};
  {
    std::lock_guard lock(mutex_);
    state.refresh_requests = static_cast<std::uint32_t>(stats_.refresh_requests);
    state.finishing = finishing_;
  }
  if (Status s = port_.send_state(state); !s) log::warn("{}", s.message());
  next_heartbeat_ = Clock::now() + timing_.heartbeat;
}

void Uplink::resend_if_stuck() {
  if (sent_ == 0 || Clock::now() < progress_ + resend_after_) return;
  sent_ = 0;
  resend_after_ = std::min(2 * resend_after_, timing_.resend_most);
  std::lock_guard lock(mutex_);
  ++stats_.resends;
}

void Uplink::send_window(std::stop_token stop) {
  retry_at_ = {};
  {
    std::lock_guard lock(mutex_);
    if (!connected_at(Clock::now()) || !status_.ok()) return;
  }
  const auto& waiting = outbox_->waiting();
  if (waiting.empty()) return;
  if (waiting.front().epoch != stream_) {
    stream_ = waiting.front().epoch;
    sent_ = 0;
  }
  const auto window = windows_.find(stream_);
  // A server that has lost its journal counts from 0 until `oldest` tells it better.
  std::uint64_t limit = std::uint64_t{waiting.front().sequence} + kFirstCredits;
  if (window != windows_.end() && window->second.next_sequence >= waiting.front().sequence)
    limit = std::uint64_t{window->second.next_sequence} + window->second.credits;
  while (sent_ < waiting.size() && !stop.stop_requested()) {
    const KeyframeId id = waiting[sent_];
    if (id.epoch != stream_ || id.sequence >= limit || !send_one(id)) return;
    if (sent_++ == 0) progress_ = Clock::now();
  }
}

bool Uplink::send_one(KeyframeId id) {
  const auto blob = outbox_->get(id);
  if (!blob) {
    fail(blob.error());
    return false;
  }
  const Status s = port_.send_keyframe({.client = {client_.name, id.epoch},
                                        .sequence = id.sequence,
                                        .oldest = outbox_->waiting().front().sequence,
                                        .blob = *blob});
  if (!s) {
    if (s.error().code != ErrorCode::kTimeout) log::warn("{}", s.message());
    retry_at_ = Clock::now() + timing_.retry;
    return false;
  }
  std::lock_guard lock(mutex_);
  stats_.bytes += blob->size();
  return true;
}

}  // namespace cairn
