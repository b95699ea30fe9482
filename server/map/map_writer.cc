#include "server/map/map_writer.h"

#include <memory>
#include <utility>

#include "common/util/thread.h"

namespace cairn {

MapWriter::MapWriter(Map initial, std::size_t queue_capacity)
    : map_(std::move(initial)),
      published_(std::make_shared<const Map>(map_)),
      queue_(queue_capacity),
      thread_([this] {
        name_this_thread("map writer");
        run();
      }) {}

MapWriter::~MapWriter() {
  close();
}

Snapshot MapWriter::snapshot() const {
  std::lock_guard lock(mutex_);
  return published_;
}

std::future<Applied> MapWriter::post(MapEvent event) {
  // Shared with the queue: a closed one drops what is pushed, and the promise has to be kept still.
  auto entry = std::make_shared<Entry>();
  entry->event = std::move(event);
  std::future<Applied> applied = entry->applied.get_future();
  if (!queue_.push(entry)) entry->applied.set_value(Applied{});
  return applied;
}

void MapWriter::close() {
  queue_.close();
  std::call_once(joined_, [this] { thread_.join(); });
}

void MapWriter::run() {
  while (auto entry = queue_.pop()) {
    Applied applied{.done = true, .keyframe = {}, .delta = {}, .snapshot = nullptr};
    MapEvent& event = (*entry)->event;
    if (auto* keyframe = std::get_if<KeyframePtr>(&event))
      applied.keyframe = apply_keyframe(map_, std::move(*keyframe));
    else if (auto* delta = std::get_if<MapDelta>(&event))
      applied.delta = apply_delta(map_, *delta);
    else if (auto* closure = std::get_if<LoopClosure>(&event))
      applied.delta = apply_loop(map_, *closure);
    applied.snapshot = publish();
    (*entry)->applied.set_value(std::move(applied));
  }
}

Snapshot MapWriter::publish() {
  auto next = std::make_shared<const Map>(map_);
  Snapshot last = next;
  {
    std::lock_guard lock(mutex_);
    published_.swap(last);
  }
  return next;  // `last`, and perhaps what it alone held, goes outside the lock
}

}  // namespace cairn
