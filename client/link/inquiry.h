// Asks the server where a view lies, and keeps its answer until tracking takes it.
//
// Only the latest view counts: a question takes the place of one that has not gone out yet, and an
// answer that of one that nobody has taken.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>

#include "common/model/keyframe.h"
#include "common/model/relocalise.h"
#include "common/util/status.h"
#include "common/wire/topics.h"

namespace cairn {

class Inquiry {
 public:
  struct Stats {
    std::uint64_t asked = 0, answered = 0, malformed = 0;
    std::uint64_t bytes_up = 0, bytes_down = 0;  // blobs
  };
  // From send_waiting().
  using Send = std::function<Status(const wire::RelocaliseRequestMessage&)>;

  // `wake`: called by ask(), so that send_waiting() is soon; must not block.
  Inquiry(ClientId client, Send send, std::function<void()> wake)
      : client_(std::move(client)), send_(std::move(send)), wake_(std::move(wake)) {}

  // From any thread; takes microseconds. `view`: a keyframe without matches whose sequence is the
  // number of the question.
  void ask(KeyframePtr view);

  // For the thread that may write to the network.
  void send_waiting();
  void receive(const wire::RelocaliseAnswerMessage& message);

  // From any thread.
  std::optional<RelocaliseAnswer> poll();
  std::optional<RelocaliseAnswer> wait(std::chrono::nanoseconds timeout, std::stop_token stop = {});
  Stats stats() const;

 private:
  const ClientId client_;
  const Send send_;
  const std::function<void()> wake_;

  mutable std::mutex mutex_;
  std::condition_variable_any arrived_;
  KeyframePtr waiting_;  // to be sent
  std::optional<RelocaliseAnswer> answer_;
  Stats stats_;
};

}  // namespace cairn
