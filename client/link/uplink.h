// Sends keyframes: from the tracking thread's hands to the outbox, from there to the server, and
// out of the outbox once the server has acknowledged them.
//
// One thread of its own does all work. It says hello (and again every second, as a heartbeat),
// sends as many keyframes of the oldest undelivered run as the server has given credits for, and
// sends them again when acknowledgements stay away or the server has been restarted.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "client/link/outbox.h"
#include "common/model/keyframe.h"
#include "common/util/status.h"
#include "common/wire/topics.h"

namespace cairn {

class Uplink {
 public:
  // Where messages go. Both are called from the uplink's thread; both empty means that there is no
  // server and the outbox only fills.
  struct Port {
    std::function<Status(const wire::KeyframeMessage&)> send_keyframe;  // may wait; kTimeout: again
    std::function<Status(const wire::ClientStateMessage&)> send_state;
  };
  struct Timing {
    std::chrono::milliseconds heartbeat{1000};
    // Without progress for this long everything unacknowledged is sent again; doubles each time.
    std::chrono::milliseconds resend{1000}, resend_most{8000};
    std::chrono::milliseconds retry{50};  // after a write that found no room
    // Without an answer for this long the server counts as gone.
    std::chrono::milliseconds silence{3500};
    // A refusal that lasts longer is final. The server refuses the successor of a crashed client
    // until it has missed the predecessor's heartbeats.
    std::chrono::milliseconds refusal_patience{6000};
    bool lockstep = false;  // see LinkOptions
  };
  struct Stats {
    bool connected = false;
    std::chrono::steady_clock::time_point heard{};  // the server's last answer; the epoch: none
    std::uint64_t made = 0, acked = 0, waiting = 0, bytes = 0, resends = 0, refresh_requests = 0;
  };

  Uplink(ClientId client, Sensor sensor, std::unique_ptr<Outbox> outbox, Port port, Timing timing);
  ~Uplink();  // stop()
  Uplink(const Uplink&) = delete;
  Uplink& operator=(const Uplink&) = delete;

  // From any thread; take microseconds.
  void send(KeyframePtr keyframe);
  void on_ack(const wire::ServerAckMessage& ack);
  void request_refresh();
  void say_finishing();
  Stats stats() const;
  Status status() const;

  // True when nothing waits any more; false after `timeout`, at a stop or once status() is not
  // ok.
  bool wait_delivered(std::chrono::nanoseconds timeout, std::stop_token stop = {});
  // Stores what has been given to send(), says goodbye and ends the thread. An empty outbox's file
  // is removed.
  void stop();

 private:
  using Clock = std::chrono::steady_clock;
  // What other threads have left for the uplink's.
  struct Inbox {
    std::vector<KeyframePtr> keyframes;
    std::vector<wire::ServerAckMessage> acks;
    bool wake = false;
    bool empty() const { return keyframes.empty() && acks.empty() && !wake; }
  };
  struct Window {  // of one run, as the server has told it
    std::uint32_t next_sequence = 0, credits = 0;
  };

  void run(std::stop_token stop);
  Inbox wait_for_work(std::stop_token stop);
  void store(const std::vector<KeyframePtr>& keyframes);
  void handle(const wire::ServerAckMessage& ack);
  void handle_refusal(const std::string& refusal);
  void greet_server(std::uint64_t server);
  void send_state(bool leaving);
  void send_window(std::stop_token stop);
  void resend_if_stuck();
  bool send_one(KeyframeId id);
  void fail(const Error& error);
  bool connected_at(Clock::time_point now) const;

  const ClientId client_;
  const Sensor sensor_;
  const Port port_;
  const Timing timing_;

  // The uplink's thread only.
  std::unique_ptr<Outbox> outbox_;
  bool outbox_broken_ = false;
  std::map<std::uint64_t, Window> windows_;  // by epoch
  std::uint64_t stream_ = 0;                 // epoch of the run that is being delivered
  std::size_t sent_ = 0;  // of that run's waiting keyframes, as many from the front have been sent
  std::uint64_t server_ = 0;
  std::chrono::milliseconds resend_after_;
  Clock::time_point progress_{}, next_heartbeat_{}, retry_at_{}, refused_since_{};

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;    // inbox_
  std::condition_variable_any delivered_;  // stats_.waiting, status_
  Inbox inbox_;
  bool finishing_ = false;
  Stats stats_;
  Status status_;
  bool accepted_ = false;
  Clock::time_point heard_{};

  std::jthread thread_;
};

}  // namespace cairn
