// Plays a recording at its own pace, as a camera would: a frame is due when as much time has passed
// since the first one as their stamps say; frames that are overtaken by their successors while the
// caller is busy are dropped and counted.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>

#include "client/capture/frame_source.h"

namespace cairn {

class Pacer {
 public:
  // With `real_time` false every frame is due at once and none is dropped. Live sources need no
  // pacing either.
  Pacer(FrameSource& source, bool real_time)
      : source_(source), real_time_(real_time && !source.is_live()) {}

  // The next frame that is not late, nothing at the end or once a stop is asked for. Until the
  // frame is due, calls `wait(remaining)`, which may return early and should at a stop: stamps can
  // be far apart.
  Result<std::optional<Frame>> next(
      const std::function<void(std::chrono::nanoseconds remaining)>& wait, std::stop_token stop);

  std::uint64_t dropped() const { return dropped_; }

 private:
  using Clock = std::chrono::steady_clock;
  Status fetch();
  Clock::time_point due(const Frame& frame) const;  // once started

  FrameSource& source_;
  const bool real_time_;
  std::optional<Frame> ahead_;  // the frame after the one to be returned
  bool fetched_ = false;
  Clock::time_point fetched_at_{};  // when ahead_ came
  std::optional<Clock::time_point> start_;
  std::int64_t first_stamp_ns_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace cairn
