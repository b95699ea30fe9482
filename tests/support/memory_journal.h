// A journal that outlives the server it is given to, as a file would.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <vector>

#include "server/ingest/journal.h"

namespace cairn::testing {

class MemoryJournal : public Journal {
 public:
  Status append(const ClientId& client, KeyframeId id,
                std::span<const std::uint8_t> blob) override {
    if (broken) return {ErrorCode::kUnavailable, "journal broken by the test"};
    std::lock_guard lock(mutex_);
    auto& run = runs_[client];
    run.sequences.push_back(id.sequence);
    run.bytes += blob.size();
    return {};
  }
  std::uint32_t next_sequence(const ClientId& client) override {
    std::lock_guard lock(mutex_);
    const auto& sequences = runs_[client].sequences;
    return sequences.empty() ? 0 : sequences.back() + 1;
  }
  // In the order of their arrival.
  std::vector<std::uint32_t> sequences(const ClientId& client) const {
    std::lock_guard lock(mutex_);
    const auto it = runs_.find(client);
    return it == runs_.end() ? std::vector<std::uint32_t>{} : it->second.sequences;
  }

  std::atomic<bool> broken = false;

 private:
  struct Run {
    std::vector<std::uint32_t> sequences;
    std::size_t bytes = 0;
  };
  mutable std::mutex mutex_;
  std::map<ClientId, Run> runs_;
};

}  // namespace cairn::testing
