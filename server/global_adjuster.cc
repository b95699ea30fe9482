#include "server/global_adjuster.h"

#include <algorithm>
#include <utility>

#include "common/util/clock.h"
#include "common/util/log.h"
#include "common/util/memory.h"
#include "common/util/thread.h"
#include "server/map/connected.h"

namespace cairn {
namespace {

constexpr int kMaxRestarts = 2;
// It takes seconds, and mapping goes first (yield_to_others()); but clients that have come to their
// end wait for it.
constexpr int kGivesWay = 7;

}  // namespace

GlobalAdjuster::GlobalAdjuster(MapWriter& writer, const GlobalAdjusterOptions& options, Done done)
    : writer_(writer), options_(options), done_(std::move(done)), thread_([this] {
        name_this_thread("global adjuster");
        yield_to_others(kGivesWay);
        run();
      }) {}

GlobalAdjuster::~GlobalAdjuster() {
  stop();
}

GlobalAdjuster::Ticket GlobalAdjuster::request(KeyframeId part_of, bool after_loop) {
  std::lock_guard lock(mutex_);
  const Ticket ticket = ++last_ticket_;
  if (!closed_) waiting_.push_back({part_of, after_loop, Clock::now(), {ticket}});
  if (after_loop) last_loop_ = Clock::now();
  if (after_loop && may_restart_) current_.request_stop();
  changed_.notify_all();
  return ticket;
}

void GlobalAdjuster::wait_idle() {
  std::unique_lock lock(mutex_);
  ++waiters_;
  changed_.notify_all();
  changed_.wait(lock, [&] { return closed_ || (!busy_ && waiting_.empty()); });
  --waiters_;
}

std::uint64_t GlobalAdjuster::adjustments() const {
  std::lock_guard lock(mutex_);
  return adjustments_;
}

void GlobalAdjuster::stop() {
  {
    std::lock_guard lock(mutex_);
    closed_ = true;
    current_.request_stop();
    changed_.notify_all();
  }
  if (thread_.joinable()) thread_.join();
}

GlobalAdjuster::Request GlobalAdjuster::take() {
  Request request = std::move(waiting_.front());
  waiting_.pop_front();
  // Keyframes may have been culled since they were named.
  const Snapshot map = writer_.snapshot();
  const std::vector<KeyframeId> part = connected_keyframes(*map, map->present(request.part_of));
  std::erase_if(waiting_, [&](const Request& other) {
    if (!std::binary_search(part.begin(), part.end(), map->present(other.part_of))) return false;
    request.tickets.insert(request.tickets.end(), other.tickets.begin(), other.tickets.end());
    request.restarts = std::max(request.restarts, other.restarts);
    return true;
  });
  return request;
}

void GlobalAdjuster::wait_for_work(std::unique_lock<std::mutex>& lock) {
  changed_.wait(lock, [&] { return closed_ || !waiting_.empty(); });
  const auto is_wanted_now = [&] {
    return closed_ || waiters_ > 0 ||
           std::any_of(waiting_.begin(), waiting_.end(),
                       [](const Request& r) { return !r.after_loop; });
  };
  const auto burst_ends = [&] {
    return std::min(last_loop_ + options_.pause, waiting_.front().asked + options_.longest_burst);
  };
  while (!is_wanted_now() && Clock::now() < burst_ends()) changed_.wait_until(lock, burst_ends());
}

void GlobalAdjuster::run() {
  std::unique_lock lock(mutex_);
  while (true) {
    wait_for_work(lock);
    if (closed_) return;
    Request request = take();
    busy_ = true;
    may_restart_ = request.restarts < kMaxRestarts;
    current_ = {};
    const std::stop_token stop = current_.get_token();
    lock.unlock();
    const bool finished = adjust(request, stop);
    if (finished) done_(request.tickets);
    lock.lock();
    busy_ = false;
    if (!finished && !closed_) {
      ++request.restarts;
      waiting_.push_back(std::move(request));
    }
    changed_.notify_all();
  }
}

bool GlobalAdjuster::adjust(const Request& request, std::stop_token stop) {
  while (!stop.stop_requested()) {
    const Snapshot map = writer_.snapshot();
    Stopwatch watch;
    GlobalBaSummary summary;
    MapDelta delta =
        solve_global_ba(*map, map->present(request.part_of), options_.ba, &summary, stop);
    release_free_memory();  // of the solver: hundreds of bytes an observation
    log::info(
        "global BA: {} keyframes, {} landmarks, cost {:.0f} -> {:.0f}, {} outliers, {:.0f} ms: {}",
        summary.keyframes, summary.landmarks, summary.initial_cost, summary.final_cost,
        summary.outliers, watch.milliseconds(), summary.message);
    if (stop.stop_requested()) return false;
    if (delta.empty()) return true;
    const Applied applied = writer_.submit(std::move(delta));
    if (applied.done && applied.delta.is_void) continue;
    std::lock_guard lock(mutex_);
    ++adjustments_;
    return true;
  }
  return false;
}

}  // namespace cairn
