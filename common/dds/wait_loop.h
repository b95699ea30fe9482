// A thread that waits for data on readers, for time to pass, and for being woken.
//
// A waitset and not listeners: a listener runs in whatever thread of DDS, even inside a write of
// this very process, and must not touch the entities it listens to.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "common/dds/participant.h"

namespace cairn::dds {

class WaitLoop {
 public:
  struct Source {
    std::int32_t condition;             // SampleReader::condition()
    std::function<void()> on_readable;  // must take what is there
  };

  // Starts the thread. `on_tick` runs every `period`, and soon after each wake(). All callbacks run
  // in the thread, one at a time. Readers must outlive the loop.
  static Result<std::unique_ptr<WaitLoop>> start(std::shared_ptr<Participant> participant,
                                                 std::vector<Source> sources,
                                                 std::chrono::milliseconds period,
                                                 std::function<void()> on_tick);
  ~WaitLoop();  // stop()
  WaitLoop(const WaitLoop&) = delete;
  WaitLoop& operator=(const WaitLoop&) = delete;

  void wake();
  // Ends the thread once the callback that is running has returned. Not from inside a callback.
  void stop();

 private:
  WaitLoop() = default;
  void run(std::stop_token stop);

  std::shared_ptr<Participant> participant_;
  std::vector<Source> sources_;
  std::chrono::milliseconds period_{};
  std::function<void()> on_tick_;
  Entity waitset_, guard_;
  std::jthread thread_;
};

}  // namespace cairn::dds
