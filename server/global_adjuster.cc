#include "server/global_adjuster.h"

#include <utility>

#include "common/util/log.h"

namespace cairn {

GlobalAdjuster::GlobalAdjuster(MapWriter& writer, const GlobalBaOptions& options,
                               std::function<void()> adjusted)
    : writer_(writer),
      options_(options),
      adjusted_(std::move(adjusted)),
      thread_([this] { run(); }) {}

GlobalAdjuster::~GlobalAdjuster() {
  stop();
}

void GlobalAdjuster::request(KeyframeId part_of, bool restart) {
  {
    std::lock_guard lock(mutex_);
    wanted_ = part_of;
    if (restart) current_.request_stop();
  }
  changed_.notify_all();
}

bool GlobalAdjuster::idle() const {
  std::lock_guard lock(mutex_);
  return closed_ || (!busy_ && !wanted_.is_valid());
}

void GlobalAdjuster::wait_idle(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, stop, [&] { return closed_ || (!busy_ && !wanted_.is_valid()); });
}

std::uint64_t GlobalAdjuster::adjusted_keyframes() const {
  std::lock_guard lock(mutex_);
  return adjusted_keyframes_;
}

std::uint64_t GlobalAdjuster::adjustments() const {
  std::lock_guard lock(mutex_);
  return adjustments_;
}

double GlobalAdjuster::last_ms() const {
  std::lock_guard lock(mutex_);
  return last_ms_;
}

void GlobalAdjuster::stop() {
  {
    std::lock_guard lock(mutex_);
    closed_ = true;
    current_.request_stop();
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void GlobalAdjuster::run() {
  while (true) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || wanted_.is_valid(); });
    if (closed_) return;
    const KeyframeId part_of = std::exchange(wanted_, {});
    busy_ = true;
    current_ = {};
    const std::stop_token stop = current_.get_token();
    lock.unlock();
    adjust(part_of, stop);
    lock.lock();
    busy_ = false;
    lock.unlock();
    changed_.notify_all();
    adjusted_();
  }
}

void GlobalAdjuster::adjust(KeyframeId part_of, std::stop_token stop) {
  while (!stop.stop_requested()) {
    const Snapshot map = writer_.snapshot();
    Stopwatch watch;
    GlobalBaSummary summary;
    MapDelta delta = solve_global_ba(*map, part_of, options_, &summary, stop);
    log::info(
        "global BA: {} keyframes, {} landmarks, cost {:.0f} -> {:.0f}, {} outliers, {:.0f} ms: {}",
        summary.keyframes, summary.landmarks, summary.initial_cost, summary.final_cost,
        summary.outliers, watch.milliseconds(), summary.message);
    if (delta.empty()) return;
    const Applied applied = writer_.submit(std::move(delta));
    if (!applied.done) return;
    if (applied.delta.is_void) continue;
    std::lock_guard lock(mutex_);
    adjusted_keyframes_ = map->keyframes_ever;
    ++adjustments_;
    last_ms_ = watch.milliseconds();
    return;
  }
}

}  // namespace cairn
