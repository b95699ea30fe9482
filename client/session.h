// One run of a client: capture -> frontend -> tracking -> link, and corrections back.
#pragma once

#include <chrono>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "client/client_config.h"
#include "client/trajectory_files.h"

namespace cairn {

struct SessionOptions {
  ClientConfig config;
  std::string input;  // see open_source()
  std::string name = "camera";
  std::string trajectory;  // TUM file to write, or the first of several; empty: none
  std::string outbox;      // empty: NAME.outbox in the working directory
  bool max_rate = false;   // every frame, as fast as tracking and mapping allow
  bool lockstep = false;   // wait for the server's answer to each keyframe
  bool no_server = false;
  std::chrono::duration<double> timeout{30};  // for the end: delivery and the last corrections
};

struct SessionReport {
  std::uint64_t frames = 0, tracked = 0, dropped = 0, skipped = 0;
  std::uint64_t keyframes = 0, mapped = 0, acknowledged = 0, undelivered = 0;
  std::uint64_t bytes_up = 0, bytes_down = 0;
  // Of the map, that the run has been in and that were never merged; each has a file of its own.
  std::size_t parts = 0;
  std::vector<TrajectoryFile> trajectories;
  double seconds = 0;                 // from the first frame to the last
  std::vector<double> tracking_ms;    // each frame: features, pose, keyframe
  std::vector<double> extraction_ms;  // the features alone
  std::vector<double> correction_ms;  // keyframe sent -> its mapping back
};

// Runs until the source ends or a stop is asked for. Errors: the source, the outbox or the file of
// the trajectory is unusable, the server refuses the client, or lockstep waited in vain.
Result<SessionReport> run_session(const SessionOptions& options, std::stop_token stop);

}  // namespace cairn
