// A client that sends recorded keyframes at an even pace through the real link, and notes what
// comes back. It does not track: what it costs the machine is its link.
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <stop_token>
#include <thread>
#include <vector>

#include "client/link/link.h"
#include "common/dds/participant.h"
#include "tests/bench/swarm/recorded_walk.h"

namespace cairn::bench {

struct ReplayResult {
  std::vector<double> correction_ms;  // each keyframe: from sent to the update that has it mapped
  std::vector<std::size_t> backlog;   // after each keyframe sent: how many were not mapped
  std::map<KeyframeId, std::chrono::system_clock::time_point> sent;
  Trajectory keyframes;  // map_from_camera as the server told last
  LinkStats link;
  double seconds = 0;  // of sending
  bool settled = false;
};

class ReplayedClient {
 public:
  // `walk` must outlive this. Error: the link can't be had.
  static Result<std::unique_ptr<ReplayedClient>> make(const RecordedWalk& walk,
                                                      double keyframes_per_s,
                                                      const std::filesystem::path& outbox,
                                                      const dds::ParticipantOptions& dds);

  // Begins to send after `delay`, so that not all clients do at once.
  void start(std::chrono::nanoseconds delay);
  // Waits until all is sent, delivered and corrected.
  ReplayResult finish();

 private:
  ReplayedClient(const RecordedWalk& walk, double keyframes_per_s, std::unique_ptr<Link> link);
  void run(std::chrono::nanoseconds delay);
  void listen_until(std::chrono::steady_clock::time_point end);
  void take(const MapUpdate& update);
  void deliver();

  const RecordedWalk& walk_;
  const std::chrono::nanoseconds period_;
  const std::unique_ptr<Link> link_;
  // The thread's, until it has ended.
  std::map<KeyframeId, Sim3> poses_;
  std::size_t sent_ = 0, mapped_ = 0;
  ReplayResult result_;
  std::jthread thread_;
};

}  // namespace cairn::bench
