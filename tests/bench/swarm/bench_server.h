// A cairn-server of the benchmark's own: on a loopback network where nobody else is, with a map
// file in a folder that is removed at the end.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/dds/participant.h"
#include "common/util/status.h"
#include "server/map/map.h"
#include "tests/bench/swarm/server_usage.h"
#include "tests/integration/process.h"
#include "tests/support/loopback.h"
#include "tests/support/temp_folder.h"

namespace cairn::bench {

struct MapSize {
  std::size_t keyframes = 0, landmarks = 0;
};

class BenchServer {
 public:
  // Ready when this returns. Error: it does not start.
  static Result<std::unique_ptr<BenchServer>> start(const std::vector<std::string>& arguments);

  dds::ParticipantOptions node() const { return net_.node(); }  // for a client
  std::string file(const std::string& name) const { return folder_ / name; }
  Usage usage() const { return usage_of(process_->pid()); }
  std::string log() const { return process_->err(); }
  // As its status page says.
  Result<MapSize> map_size() const;
  // Ends it, by SIGTERM. Error: it does not end well.
  Status stop();
  // The map that it has saved; after stop().
  Result<Map> map() const;

 private:
  BenchServer() = default;

  const synthetic::TempFolder folder_;
  const testing::Loopback net_;
  std::unique_ptr<testing::Process> process_;
};

}  // namespace cairn::bench
