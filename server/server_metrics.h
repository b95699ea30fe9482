// What the server counts and measures about itself, and how it is shown.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "server/ingest/ingest.h"

namespace cairn {

// A moment's view of the server.
struct ServerState {
  std::uint64_t map_id = 0, map_revision = 0;
  std::size_t keyframes = 0, landmarks = 0;
  std::uint64_t keyframes_ever = 0;
  std::size_t awaiting_mapping = 0;
  std::uint64_t mapped = 0;  // keyframes since the start
  std::size_t desks = 0;     // client runs that mapping keeps something for
  double uptime_s = 0;
  double mapping_ms_median = 0, mapping_ms_p95 = 0;  // of one keyframe, without the solve
  double solving_ms_median = 0;                      // the bundle adjustment in it
  double answer_ms_median = 0, answer_ms_p95 = 0;    // keyframe received -> corrections sent
  std::uint64_t located = 0;    // clients' questions where they are that were answered with a place
  double locate_ms_median = 0;  // of any answer, the wait for its turn included
  IngestStats ingest;
  std::vector<ClientInfo> clients;
};

std::string to_json(const ServerState& state);
std::string to_prometheus(const ServerState& state);

// The last `capacity` values of a measurement. All members are safe from any thread.
class RecentValues {
 public:
  explicit RecentValues(std::size_t capacity = 1024) : capacity_(capacity) {}
  void add(double value);
  // The value below which the given share lies; 0 when there are none.
  double quantile(double share) const;

 private:
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::vector<double> values_;  // a ring once full
  std::size_t next_ = 0;
};

struct ServerMetrics {
  RecentValues mapping_ms, solving_ms, answer_ms, locate_ms;
  std::atomic<std::uint64_t> mapped = 0;   // keyframes
  std::atomic<std::uint64_t> located = 0;  // views of lost clients
};

}  // namespace cairn
