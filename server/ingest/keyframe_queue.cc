#include "server/ingest/keyframe_queue.h"

#include <algorithm>
#include <utility>

#include "common/util/log.h"

namespace cairn {

// References into runs_ stay valid while others are inserted; only the offering thread (forget) and
// done() (a forgotten run that is empty) erase, and done() leaves runs alone that the offering
// thread may be working on: those are not forgotten.
KeyframeQueue::Run& KeyframeQueue::open(const ClientId& client) {
  Run* run = nullptr;
  {
    std::lock_guard lock(mutex_);
    run = &runs_[client];
    run->forgotten = false;
  }
  if (!run->opened) {
    run->opened = true;
    run->next_sequence = journal_.next_sequence(client);
  }
  return *run;
}

std::uint32_t KeyframeQueue::taken(const Run& run) {
  return static_cast<std::uint32_t>(run.ready.size()) + run.handed_out;
}

std::uint32_t KeyframeQueue::room(const Run& run) const {
  return taken(run) < capacity_ ? capacity_ - taken(run) : 0;
}

KeyframeQueue::Window KeyframeQueue::window(const ClientId& client) {
  Run& run = open(client);
  std::lock_guard lock(mutex_);
  const Window window{run.next_sequence, room(run)};
  if (window.credits <= capacity_ / 2) run.wants_room = true;
  return window;
}

KeyframeQueue::Arrival KeyframeQueue::offer(const ClientId& client, std::uint32_t oldest,
                                            KeyframePtr keyframe, wire::Bytes blob) {
  Run& run = open(client);
  const std::uint32_t sequence = keyframe->id.sequence;
  if (oldest > run.next_sequence) {
    log::warn("client {}: keyframes {} to {} went to an earlier server, going on without them",
              client.name, run.next_sequence, oldest - 1);
    run.next_sequence = oldest;
    run.early.erase(run.early.begin(), run.early.lower_bound(oldest));
  }
  if (sequence < run.next_sequence || run.early.contains(sequence)) return Arrival::kDuplicate;
  {
    std::lock_guard lock(mutex_);
    if (sequence - run.next_sequence >= room(run)) {
      run.wants_room = true;
      return Arrival::kBeyond;
    }
  }
  if (sequence > run.next_sequence) {
    run.early.emplace(sequence, Early{std::move(keyframe), wire::Blob(blob.begin(), blob.end())});
    return Arrival::kEarly;
  }
  if (!admit(client, run, std::move(keyframe), blob)) return Arrival::kNotJournaled;
  // Those that have waited for this one.
  for (auto it = run.early.begin(); it != run.early.end() && it->first == run.next_sequence;) {
    if (!admit(client, run, it->second.keyframe, it->second.blob)) break;
    it = run.early.erase(it);
  }
  return Arrival::kAccepted;
}

bool KeyframeQueue::admit(const ClientId& client, Run& run, KeyframePtr keyframe,
                          wire::Bytes blob) {
  const KeyframeId id = keyframe->id;
  if (Status s = journal_.append(client, id, blob); !s) {
    std::lock_guard lock(mutex_);
    // One line an outage, not one a keyframe.
    if (journal_failures_++ == 0) log::error("keyframes cannot be journaled: {}", s.message());
    return false;
  }
  {
    std::lock_guard lock(mutex_);
    run.next_sequence = id.sequence + 1;
    run.ready.push_back({client, std::move(keyframe), std::chrono::steady_clock::now()});
    ++queued_;
    ++accepted_;
  }
  changed_.notify_all();
  return true;
}

void KeyframeQueue::forget(const ClientId& client) {
  std::lock_guard lock(mutex_);
  const auto it = runs_.find(client);
  if (it == runs_.end()) return;
  it->second.early.clear();
  it->second.forgotten = true;
  if (taken(it->second) == 0) runs_.erase(it);
}

std::optional<IncomingKeyframe> KeyframeQueue::next(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, stop, [&] { return closed_ || queued_ > 0; });
  if (queued_ == 0 || stop.stop_requested()) return std::nullopt;
  // The first run with something ready after the one that was served last, round and round.
  auto it = served_last_ ? runs_.upper_bound(*served_last_) : runs_.begin();
  while (it == runs_.end() || it->second.ready.empty())
    it = it == runs_.end() ? runs_.begin() : std::next(it);
  Run& run = it->second;
  std::optional<IncomingKeyframe> incoming(std::move(run.ready.front()));
  run.ready.pop_front();
  ++run.handed_out;
  --queued_;
  served_last_ = it->first;
  return incoming;
}

void KeyframeQueue::done(const ClientId& client) {
  bool tell = false;
  {
    std::lock_guard lock(mutex_);
    const auto it = runs_.find(client);
    if (it == runs_.end() || it->second.handed_out == 0) return;
    Run& run = it->second;
    --run.handed_out;
    tell = run.wants_room && room(run) > capacity_ / 2;
    if (tell) run.wants_room = false;
    if (run.forgotten && taken(run) == 0) runs_.erase(it);
  }
  if (tell && on_room_) on_room_();
}

void KeyframeQueue::close() {
  {
    std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
}

std::uint32_t KeyframeQueue::queued() const {
  std::lock_guard lock(mutex_);
  return queued_;
}

std::uint32_t KeyframeQueue::queued(const ClientId& client) const {
  std::lock_guard lock(mutex_);
  const auto it = runs_.find(client);
  return it == runs_.end() ? 0 : taken(it->second);
}

std::uint64_t KeyframeQueue::accepted() const {
  std::lock_guard lock(mutex_);
  return accepted_;
}

std::uint64_t KeyframeQueue::journal_failures() const {
  std::lock_guard lock(mutex_);
  return journal_failures_;
}

}  // namespace cairn
