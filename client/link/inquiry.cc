#include "client/link/inquiry.h"

#include <utility>

#include "common/util/log.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/relocalise_codec.h"

namespace cairn {

void Inquiry::ask(KeyframePtr view) {
  {
    std::lock_guard lock(mutex_);
    waiting_ = std::move(view);
  }
  wake_();
}

void Inquiry::send_waiting() {
  KeyframePtr view;
  {
    std::lock_guard lock(mutex_);
    view = std::exchange(waiting_, nullptr);
  }
  if (!view) return;
  const auto blob = wire::encode_keyframe(client_.name, *view);
  const Status sent = blob ? send_({.client = {client_.name, view->id.epoch},
                                    .number = view->id.sequence,
                                    .blob = *blob})
                           : Status(blob.error());
  if (!sent) return log::warn("can't ask the server where this is: {}", sent.message());
  std::lock_guard lock(mutex_);
  ++stats_.asked;
  stats_.bytes_up += blob->size();
}

void Inquiry::receive(const wire::RelocaliseAnswerMessage& message) {
  if (message.client != client_) return;
  auto decoded = wire::decode_answer(message.blob);
  const bool sound = decoded && decoded->client == client_.name &&
                     decoded->answer.epoch == client_.epoch &&
                     decoded->answer.number == message.number;
  if (!sound)
    log::warn("unusable answer: {}", decoded ? "head and contents differ" : decoded.message());
  {
    std::lock_guard lock(mutex_);
    stats_.bytes_down += message.blob.size();
    ++(sound ? stats_.answered : stats_.malformed);
    if (sound) answer_ = std::move(decoded->answer);
  }
  arrived_.notify_all();
}

std::optional<RelocaliseAnswer> Inquiry::poll() {
  std::lock_guard lock(mutex_);
  return std::exchange(answer_, std::nullopt);
}

std::optional<RelocaliseAnswer> Inquiry::wait(std::chrono::nanoseconds timeout,
                                              std::stop_token stop) {
  std::unique_lock lock(mutex_);
  arrived_.wait_for(lock, stop, timeout, [&] { return answer_.has_value(); });
  return std::exchange(answer_, std::nullopt);
}

Inquiry::Stats Inquiry::stats() const {
  std::lock_guard lock(mutex_);
  return stats_;
}

}  // namespace cairn
