#include "client/pacer.h"

#include <algorithm>
#include <utility>

namespace cairn {

Status Pacer::fetch() {
  const Clock::time_point asked = Clock::now();
  Result<std::optional<Frame>> frame = source_.next();
  if (!frame) return frame.error();
  ahead_ = std::move(*frame);
  fetched_at_ = Clock::now();
  if (!ahead_ || !start_) return {};
  // A source that is slower than the recording's own pace (a rendered scene, a slow disk) makes its
  // frames late itself: the clock waits for it, or ever more frames would be dropped.
  if (due(*ahead_) < fetched_at_)
    start_ = *start_ + std::min(fetched_at_ - asked, fetched_at_ - due(*ahead_));
  return {};
}

Pacer::Clock::time_point Pacer::due(const Frame& frame) const {
  return *start_ + std::chrono::nanoseconds(frame.stamp_ns - first_stamp_ns_);
}

Result<std::optional<Frame>> Pacer::next(const std::function<void(std::chrono::nanoseconds)>& wait,
                                         std::stop_token stop) {
  if (!real_time_) return source_.next();
  if (!fetched_) {
    if (Status s = fetch(); !s) return s.error();
    fetched_ = true;
  }
  if (!ahead_) return std::optional<Frame>();
  Frame frame = std::move(*ahead_);
  if (Status s = fetch(); !s) return s.error();
  if (!start_) {
    start_ = Clock::now();
    first_stamp_ns_ = frame.stamp_ns;
  }
  // Overtaken: the next one was due before it was asked for, not only since the source made us
  // wait.
  while (ahead_ && due(*ahead_) < fetched_at_) {
    ++dropped_;
    frame = std::move(*ahead_);
    if (Status s = fetch(); !s) return s.error();
  }
  for (auto now = Clock::now(); now < due(frame); now = Clock::now()) {
    if (stop.stop_requested()) return std::optional<Frame>();
    wait(due(frame) - now);
  }
  return std::optional<Frame>(std::move(frame));
}

}  // namespace cairn
