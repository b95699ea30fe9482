// Everything that the server's YAML file can say. Every key has a default; config/server.yaml lists
// them with unit and range.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "common/util/status.h"
#include "server/publish/publish.h"
#include "server/verify/verify.h"

namespace cairn {

struct ServerConfig {
  std::uint32_t domain = 0;
  std::string partition = "cairn";
  std::string map_file;  // empty: the map is gone when the server ends
  std::string http;      // ADDR:PORT of the status pages; empty: none
  std::string log_level = "info";
  std::uint32_t queue_capacity = 32;  // keyframes of a client run, on their way or unmapped
  int mapping_threads = 2;            // keyframes mapped at once, each of another client
  double save_every_s = 30;
  double forget_client_s = 600;  // of silence, after which a client counts as gone
  // Local bundle adjustment: keyframes that are solved for at once.
  int local_window = 15;
  // From here on keyframes must say more to stay; see CullOptions.
  std::size_t keyframe_budget = 3000, landmark_budget = 300'000;
  bool close_loops = true;
  std::string vocabulary;  // empty: the one that is built in
  PublishOptions publish;  // what clients are told of the map
  VerifyOptions verify;    // what a loop must show to be believed
};

// One line with file, key and line on what is wrong.
Result<ServerConfig> load_server_config(const std::string& path);

}  // namespace cairn
