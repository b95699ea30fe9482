// Global bundle adjustment in the background: one thread, one part of the map at a time. Whatever
// has become void by a loop that was closed meanwhile is started anew; mapping does not wait.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "server/map/map_writer.h"
#include "server/optimize/global_ba.h"

namespace cairn {

struct GlobalAdjusterOptions {
  GlobalBaOptions ba = {};
  // Loops come in bursts, when clients meet: unless something else waits too, the adjustment begins
  // when none has come for a while, or after the longest time for a burst.
  std::chrono::milliseconds pause{1000}, longest_burst{5000};
};

class GlobalAdjuster {
 public:
  using Ticket = std::uint64_t;
  // Called on the adjuster's thread when the requests with these tickets are done; must not block.
  using Done = std::function<void(const std::vector<Ticket>&)>;

  // `writer` must outlive this.
  GlobalAdjuster(MapWriter& writer, const GlobalAdjusterOptions& options, Done done);
  ~GlobalAdjuster();
  GlobalAdjuster(const GlobalAdjuster&) = delete;
  GlobalAdjuster& operator=(const GlobalAdjuster&) = delete;

  // Adjusts the part of the map that holds this keyframe, as it is when its turn comes. Requests
  // for one part that wait together are one. With `after_loop` the adjustment under way starts
  // over, since a loop has made it void; but not for ever: after two restarts it runs to its end.
  // When: see GlobalAdjusterOptions.
  Ticket request(KeyframeId part_of, bool after_loop);
  // Until nothing is under way or asked for, or stop().
  void wait_idle();
  std::uint64_t adjustments() const;  // that changed the map

  // Ends the one under way without a result; requests are not taken any more.
  void stop();

 private:
  using Clock = std::chrono::steady_clock;
  struct Request {
    KeyframeId part_of;
    bool after_loop = false;
    Clock::time_point asked{};
    std::vector<Ticket> tickets;
    int restarts = 0;
  };
  void run();
  // Until there is something to do, or closed_.
  void wait_for_work(std::unique_lock<std::mutex>& lock);
  // The first request, with those for the same part.
  Request take();
  // False: it was stopped.
  bool adjust(const Request& request, std::stop_token stop);

  MapWriter& writer_;
  const GlobalAdjusterOptions options_;
  const Done done_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Request> waiting_;
  Clock::time_point last_loop_{};
  int waiters_ = 0;  // in wait_idle()
  bool busy_ = false, closed_ = false, may_restart_ = true;
  std::stop_source current_;
  Ticket last_ticket_ = 0;
  std::uint64_t adjustments_ = 0;
  std::jthread thread_;
};

}  // namespace cairn
