#include "client/capture/read_ahead.h"

#include <utility>

#include "common/util/log.h"

namespace cairn {

ReadAhead::ReadAhead(std::string name, CameraConfig camera, std::optional<std::uint64_t> size,
                     Producer produce)
    : name_(std::move(name)),
      camera_(std::move(camera)),
      size_(size),
      produce_(std::move(produce)),
      thread_([this](std::stop_token stop) { read(std::move(stop)); }) {}

void ReadAhead::read(std::stop_token stop) {
  std::uint64_t skipped = 0;
  std::string first_skip;
  while (!stop.stop_requested()) {
    Produced produced = produce_();
    if (auto* skip = std::get_if<Skipped>(&produced)) {
      log::warn("frame skipped: {}", skip->why);
      if (skipped++ == 0) first_skip = skip->why;
      continue;
    }
    // Handed over whole: an image that two threads hold lives longer than it is needed.
    auto* frame = std::get_if<Frame>(&produced);
    Item item{frame ? std::optional(std::move(*frame)) : std::nullopt, skipped, first_skip};
    if (!queue_.push(std::move(item), stop) || !frame) return;
  }
}

Result<std::optional<Frame>> ReadAhead::next() {
  if (ended_) return std::optional<Frame>();
  std::optional<Item> item = queue_.pop();
  skipped_ = item->skipped;
  if (item->frame) {
    ++delivered_;
    return std::move(item->frame);
  }
  ended_ = true;
  if (delivered_ > 0) return std::optional<Frame>();
  if (skipped_ == 0) return {ErrorCode::kNotFound, name_ + ": holds no frames"};
  return {ErrorCode::kCorrupt, name_ + ": none of " + std::to_string(skipped_) +
                                   " frames is usable; the first: " + item->first_skip};
}

}  // namespace cairn
