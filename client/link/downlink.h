// Receives map updates: joins the parts, checks that revisions follow each other, asks for a full
// refresh when they don't, and keeps whole updates until tracking takes them.
//
// Thread: receive() and on_ack() are for the receiving thread, the rest for any.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>

#include "common/model/map_update.h"
#include "common/wire/topics.h"

namespace cairn {

class Downlink {
 public:
  using Clock = std::chrono::steady_clock;
  struct Stats {
    std::uint64_t bytes = 0, updates = 0, malformed = 0;
  };

  // `ask_refresh` must not block.
  Downlink(ClientId client, std::function<void()> ask_refresh)
      : client_(std::move(client)), ask_refresh_(std::move(ask_refresh)) {}

  void receive(const wire::MapUpdateMessage& message);
  // The server's acknowledgements tell which revision it has sent; one that stays away shows so
  // even when no further update comes.
  void on_ack(const wire::ServerAckMessage& ack, Clock::time_point now);

  std::optional<MapUpdate> poll();
  std::optional<MapUpdate> wait(std::chrono::nanoseconds timeout, std::stop_token stop = {});
  Stats stats() const;

 private:
  void lose_track();
  void join(MapUpdate part, bool is_first, bool is_last);
  std::optional<MapUpdate> take(std::unique_lock<std::mutex>& lock);

  const ClientId client_;
  const std::function<void()> ask_refresh_;

  // The receiving thread only.
  std::uint64_t server_ = 0;
  std::uint64_t revision_ = 0;  // of the latest part that has come in its place
  bool lost_ = false;           // only a full refresh helps
  std::optional<MapUpdate> partial_;
  std::uint64_t stale_revision_ = 0;
  Clock::time_point stale_since_{};

  mutable std::mutex mutex_;
  std::condition_variable_any arrived_;
  std::deque<MapUpdate> whole_;
  Stats stats_;
};

}  // namespace cairn
