// Global bundle adjustment in the background: one thread, one adjustment at a time. Whatever has
// become void by a loop that was closed meanwhile is started anew; nobody waits for it.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>

#include "common/util/clock.h"
#include "server/map/map_writer.h"
#include "server/optimize/global_ba.h"

namespace cairn {

class GlobalAdjuster {
 public:
  // `writer` must outlive this. `adjusted` is called on the adjuster's thread after each result
  // that was applied, and must not block.
  GlobalAdjuster(MapWriter& writer, const GlobalBaOptions& options, std::function<void()> adjusted);
  ~GlobalAdjuster();
  GlobalAdjuster(const GlobalAdjuster&) = delete;
  GlobalAdjuster& operator=(const GlobalAdjuster&) = delete;

  // Adjusts the part of the map that holds this keyframe, as it is once earlier requests are done.
  // Stops the adjustment under way where that has lost its point (`restart`).
  void request(KeyframeId part_of, bool restart);
  // Neither under way nor asked for.
  bool idle() const;
  void wait_idle(std::stop_token stop = {});
  // Of the map, when the last adjustment that was applied was taken from it.
  std::uint64_t adjusted_keyframes() const;
  std::uint64_t adjustments() const;
  double last_ms() const;

  // Ends the one under way without a result.
  void stop();

 private:
  void run();
  void adjust(KeyframeId part_of, std::stop_token stop);

  MapWriter& writer_;
  const GlobalBaOptions options_;
  const std::function<void()> adjusted_;

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  KeyframeId wanted_;  // not valid: none
  bool busy_ = false, closed_ = false;
  std::stop_source current_;
  std::uint64_t adjusted_keyframes_ = 0, adjustments_ = 0;
  double last_ms_ = 0;
  std::jthread thread_;
};

}  // namespace cairn
