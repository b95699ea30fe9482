#include "common/dds/wait_loop.h"

#include <algorithm>

#include <dds/dds.h>

#include "common/util/log.h"

namespace cairn::dds {

using Clock = std::chrono::steady_clock;

Result<std::unique_ptr<WaitLoop>> WaitLoop::start(std::shared_ptr<Participant> participant,
                                                  std::vector<Source> sources,
                                                  std::chrono::milliseconds period,
                                                  std::function<void()> on_tick) {
  const std::string what = "DDS waitset";
  auto waitset = own(what, dds_create_waitset(participant->handle()));
  if (!waitset) return waitset.error();
  auto guard = own(what, dds_create_guardcondition(participant->handle()));
  if (!guard) return guard.error();
  // The number that the waitset gives back: the place in `sources`, or one past it for the guard.
  dds_attach_t place = 0;
  for (const Source& source : sources)
    if (const auto rc = dds_waitset_attach(waitset->handle(), source.condition, place++); rc < 0)
      return dds_error(what, rc);
  if (const auto rc = dds_waitset_attach(waitset->handle(), guard->handle(), place); rc < 0)
    return dds_error(what, rc);

  std::unique_ptr<WaitLoop> loop(new WaitLoop);
  loop->participant_ = std::move(participant);
  loop->sources_ = std::move(sources);
  loop->period_ = period;
  loop->on_tick_ = std::move(on_tick);
  loop->waitset_ = std::move(*waitset);
  loop->guard_ = std::move(*guard);
  loop->thread_ = std::jthread([self = loop.get()](std::stop_token stop) { self->run(stop); });
  return loop;
}

WaitLoop::~WaitLoop() {
  stop();
}

void WaitLoop::wake() {
  (void)dds_set_guardcondition(guard_.handle(), true);
}

void WaitLoop::stop() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  wake();
  thread_.join();
}

void WaitLoop::run(std::stop_token stop) {
  std::vector<dds_attach_t> ready(sources_.size() + 1);
  Clock::time_point next_tick = Clock::now() + period_;
  while (!stop.stop_requested()) {
    const auto wait = std::max(Clock::duration::zero(), next_tick - Clock::now());
    const auto count = dds_waitset_wait(waitset_.handle(), ready.data(), ready.size(),
                                        std::chrono::nanoseconds(wait).count());
    if (count < 0) {
      log::error("{}", dds_error("waiting for DDS data", count).message);
      return;
    }
    bool tick = Clock::now() >= next_tick;
    for (dds_return_t i = 0; i < count && !stop.stop_requested(); ++i) {
      const auto place = static_cast<std::size_t>(ready[static_cast<std::size_t>(i)]);
      if (place < sources_.size()) {
        sources_[place].on_readable();
        continue;
      }
      bool triggered = false;
      (void)dds_take_guardcondition(guard_.handle(), &triggered);
      tick = tick || triggered;
    }
    if (!tick || stop.stop_requested()) continue;
    on_tick_();
    next_tick = Clock::now() + period_;
  }
}

}  // namespace cairn::dds
