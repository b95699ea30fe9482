#include "client/link/downlink.h"

#include <utility>

#include "common/util/log.h"
#include "common/wire/map_update_codec.h"

namespace cairn {
namespace {

// Updates that wait for tracking. So many mean that it has stopped taking them; a refresh then says
// all of it shorter.
constexpr std::size_t kMostWaiting = 256;
// How long the client may be behind the server's revision without any progress.
constexpr std::chrono::seconds kPatience{3};

}  // namespace

void Downlink::receive(const wire::MapUpdateMessage& message) {
  if (message.client != client_) return;
  {
    std::lock_guard lock(mutex_);
    stats_.bytes += message.blob.size();
  }
  if (message.server != server_) {
    server_ = message.server;
    revision_ = 0;
    lost_ = false;
    partial_.reset();
  }
  if (message.revision <= revision_) return;  // repeated
  const bool is_refresh = message.base_revision == 0;
  if (!is_refresh && (lost_ || message.base_revision != revision_)) return lose_track();

  auto decoded = wire::decode_map_update(message.blob);
  if (!decoded || decoded->client != client_.name || decoded->update.epoch != client_.epoch ||
      decoded->update.base_revision != message.base_revision ||
      decoded->update.revision != message.revision) {
    log::warn("unusable map update: {}", decoded ? "head and contents differ" : decoded.message());
    {
      std::lock_guard lock(mutex_);
      ++stats_.malformed;
    }
    return lose_track();
  }
  lost_ = false;
  revision_ = message.revision;
  join(std::move(decoded->update), is_refresh || !partial_, message.last_part);
}

void Downlink::join(MapUpdate part, bool is_first, bool is_last) {
  if (is_first)
    partial_ = std::move(part);
  else
    wire::append_part(*partial_, std::move(part));
  if (!is_last) return;
  MapUpdate update = std::move(*partial_);
  partial_.reset();
  std::unique_lock lock(mutex_);
  if (whole_.size() >= kMostWaiting) {
    whole_.clear();
    lock.unlock();
    return lose_track();
  }
  whole_.push_back(std::move(update));
  lock.unlock();
  arrived_.notify_all();
}

void Downlink::lose_track() {
  partial_.reset();
  if (lost_) return;  // asked already; on_ack() asks again when nothing comes
  lost_ = true;
  ask_refresh_();
}

void Downlink::on_ack(const wire::ServerAckMessage& ack, Clock::time_point now) {
  if (ack.client != client_ || !ack.refusal.empty()) return;
  const std::uint64_t mine = ack.server == server_ ? revision_ : 0;
  const bool behind = lost_ || ack.published_revision > mine;
  if (!behind || mine != stale_revision_ || stale_since_ == Clock::time_point{}) {
    stale_revision_ = mine;
    stale_since_ = behind ? now : Clock::time_point{};
    return;
  }
  if (now - stale_since_ < kPatience) return;
  stale_since_ = now;
  lost_ = false;  // so that it is asked for
  lose_track();
}

std::optional<MapUpdate> Downlink::take(std::unique_lock<std::mutex>& lock) {
  if (whole_.empty()) return std::nullopt;
  std::optional<MapUpdate> update(std::move(whole_.front()));
  whole_.pop_front();
  ++stats_.updates;
  lock.unlock();
  return update;
}

std::optional<MapUpdate> Downlink::poll() {
  std::unique_lock lock(mutex_);
  return take(lock);
}

std::optional<MapUpdate> Downlink::wait(std::chrono::nanoseconds timeout, std::stop_token stop) {
  std::unique_lock lock(mutex_);
  arrived_.wait_for(lock, stop, timeout, [&] { return !whole_.empty(); });
  return take(lock);
}

Downlink::Stats Downlink::stats() const {
  std::lock_guard lock(mutex_);
  return stats_;
}

}  // namespace cairn
