// Keyframes between their arrival in the map and their answer to the client: whose they are and
// when they came. All members are safe from any thread.
#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <utility>

#include "common/model/ids.h"

namespace cairn {

class KeyframesUnderWay {
 public:
  struct Entry {
    ClientId client;
    std::chrono::steady_clock::time_point arrived;
    bool counts = false;  // against the client's credits
  };

  void add(KeyframeId id, Entry entry) {
    std::lock_guard lock(mutex_);
    entries_[id] = std::move(entry);
  }

  std::optional<ClientId> client_of(KeyframeId id) const {
    std::lock_guard lock(mutex_);
    const auto found = entries_.find(id);
    if (found == entries_.end()) return std::nullopt;
    return found->second.client;
  }

  // It has been answered. Nothing for one that was not under way.
  std::optional<Entry> take(KeyframeId id) {
    std::lock_guard lock(mutex_);
    auto found = entries_.extract(id);
    if (!found) return std::nullopt;
    return std::move(found.mapped());
  }

  // False: none of this run is under way. True: some are, and finished() will say when the last one
  // is through.
  bool finish_later(std::uint64_t epoch) {
    std::lock_guard lock(mutex_);
    if (!has(epoch)) return false;
    finishing_.insert(epoch);
    return true;
  }

  // Whether the run waited for its last keyframe, and that is through: true once.
  bool finished(std::uint64_t epoch) {
    std::lock_guard lock(mutex_);
    return !has(epoch) && finishing_.erase(epoch) > 0;
  }

 private:
  bool has(std::uint64_t epoch) const {
    const auto first = entries_.lower_bound({epoch, 0});
    return first != entries_.end() && first->first.epoch == epoch;
  }

  mutable std::mutex mutex_;
  std::map<KeyframeId, Entry> entries_;
  std::set<std::uint64_t> finishing_;  // runs
};

}  // namespace cairn
