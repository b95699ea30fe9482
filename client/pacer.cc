#include "client/pacer.h"

#include <utility>

namespace cairn {

Status Pacer::fetch() {
  Result<std::optional<Frame>> frame = source_.next();
  if (!frame) return frame.error();
  ahead_ = std::move(*frame);
  return {};
}

Result<std::optional<Frame>> Pacer::next(
    const std::function<void(std::chrono::nanoseconds)>& wait) {
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
  const auto due = [&](const Frame& f) {
    return *start_ + std::chrono::nanoseconds(f.stamp_ns - first_stamp_ns_);
  };
  while (ahead_ && due(*ahead_) <= Clock::now()) {
    ++dropped_;
    frame = std::move(*ahead_);
    if (Status s = fetch(); !s) return s.error();
  }
  for (auto now = Clock::now(); now < due(frame); now = Clock::now()) wait(due(frame) - now);
  return std::optional<Frame>(std::move(frame));
}

}  // namespace cairn
