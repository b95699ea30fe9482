// The server in one place: keyframes in, map, corrections out.
//
//   ingest -> journal -> map writer -> local mapping -> map -> publish -> ingest
//                                   -> loop closer -> map -> publish
//
// Threads: ingest's own receives and journals; one takes keyframes from ingest into the map as they
// come; `mapping_threads` map them, the clients in turn and one keyframe of a client at a time; one
// closes loops, one adjusts the map as a whole, one saves it now and then. None of them waits for a
// solve but the one that asked for it.
#pragma once

#include <chrono>
#include <memory>
#include <stop_token>
#include <thread>
#include <vector>

#include "common/util/clock.h"
#include "common/util/fair_queue.h"
#include "common/util/status.h"
#include "server/client_desk.h"
#include "server/http/status_server.h"
#include "server/ingest/ingest.h"
#include "server/loop_closer.h"
#include "server/map/map_writer.h"
#include "server/server_config.h"
#include "server/server_metrics.h"
#include "server/storage/map_file.h"

namespace cairn {

class Pipeline {
 public:
  // Opens the map file, loads what it holds, starts receiving. Errors: the file, the port or DDS is
  // not to be had.
  static Result<std::unique_ptr<Pipeline>> start(const ServerConfig& config);
  ~Pipeline();

  // Takes in no more, finishes what is queued, saves. The pipeline is at an end after this.
  Status stop();

  ServerState state() const;

 private:
  // Where a job comes from: only a client's keyframe counts against the client's credits.
  enum class Origin { kClient, kFile, kEvent, kFinish };
  // A keyframe to be mapped, or (not valid) something to tell the client, or that it is finishing.
  struct Job {
    KeyframeId keyframe;
    std::chrono::steady_clock::time_point arrived;
    Origin origin = Origin::kEvent;
  };

  Pipeline(const ServerConfig& config, std::unique_ptr<MapFile> file, Map map);
  Status replay_journal();
  Status start_receiving();
  void on_client_event(const ClientEvent& event);
  void insert(const ClientId& client, KeyframePtr keyframe,
              std::chrono::steady_clock::time_point arrived, Origin origin);
  void insert_keyframes();
  void map_keyframes();
  void push_keyframe(const ClientId& client, const Job& job);
  void map_keyframe(const ClientId& client, ClientDesk& desk, const Job& job);
  void answer(const ClientId& client, ClientDesk& desk, const Job& job);
  void save_now_and_then(std::stop_token stop);
  Status save();
  Status start_closing_loops();
  void tell_everyone();
  std::shared_ptr<ClientDesk> make_desk(const ClientId& client);

  const ServerConfig config_;
  std::unique_ptr<MapFile> file_;
  MapWriter writer_;
  std::unique_ptr<Ingest> ingest_;
  FairQueue<ClientId, Job> jobs_;
  ServerMetrics metrics_;
  ClientDesks desks_;
  std::unique_ptr<LoopCloser> closer_;  // null when loops are not wanted
  std::uint64_t saved_revision_ = 0;    // saver thread, then stop()
  std::unique_ptr<StatusServer> http_;
  std::jthread inserter_, saver_;
  std::vector<std::jthread> mappers_;
  const Stopwatch started_;
  bool stopped_ = false;
};

}  // namespace cairn
