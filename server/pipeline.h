// The server in one place: keyframes in, map, corrections out.
//
//   ingest -> journal -> map writer -> local mapping -> local adjuster -> map -> publish -> ingest
//                                                   -> loop closer -> map -> publish
//
// Threads: ingest's own receives and journals; one takes keyframes from ingest into the map as they
// come; `mapping_threads` map them, the clients in turn and one keyframe of a client at a time, and
// adjust what they have mapped; one closes loops, one tells lost clients where they are, one
// adjusts the map as a whole, one saves it now and then. None of them waits for a solve but the one
// that asked for it.
#pragma once

#include <atomic>
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
#include "server/keyframes_under_way.h"
#include "server/loop_closer.h"
#include "server/map/map_writer.h"
#include "server/mapping/local_adjuster.h"
#include "server/relocaliser.h"
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
  enum class Origin { kClient, kFile };
  // What is done for one client at a time.
  struct Job {
    enum class Kind {
      kMap,     // a keyframe that has come into the map
      kAnswer,  // one that has been mapped
      kTell,    // something happened that the client should know
      kFinish,  // the client has made its last keyframe
    };
    Kind kind = Kind::kTell;
    KeyframeId keyframe;  // of the first two
  };

  Pipeline(const ServerConfig& config, std::unique_ptr<MapFile> file, Map map);
  Status replay_journal();
  Status start_receiving();
  void on_client_event(const ClientEvent& event);
  void on_question(const ClientId& client, KeyframePtr view);
  void send_answer(const ClientId& client, const RelocaliseAnswer& answer, double milliseconds);
  void insert(const ClientId& client, KeyframePtr keyframe,
              std::chrono::steady_clock::time_point arrived, Origin origin);
  void insert_keyframes();
  void map_keyframes();
  void push_keyframe(const ClientId& client, KeyframeId id,
                     std::chrono::steady_clock::time_point arrived, Origin origin);
  void carry_out(const ClientId& client, ClientDesk& desk, const Job& job);
  void extend(const ClientId& client, ClientDesk& desk, KeyframeId id);
  void adjust_what_waits();
  bool on_mapped(KeyframeId id);
  void answer(const ClientId& client, ClientDesk& desk, KeyframeId id);
  void finish(const ClientId& client);
  bool tell(const ClientId& client, ClientDesk& desk);
  void save_now_and_then(std::stop_token stop);
  Status save();
  Status start_closing_loops();
  std::size_t awaiting_mapping() const;
  void tell_everyone();

  const ServerConfig config_;
  std::unique_ptr<MapFile> file_;
  MapWriter writer_;
  std::unique_ptr<Ingest> ingest_;
  FairQueue<ClientId, Job> jobs_;
  ServerMetrics metrics_;
  ClientDesks desks_;
  KeyframesUnderWay under_way_;
  std::atomic<std::size_t> unextended_ = 0;  // keyframes that wait for their kMap
  LocalAdjuster adjuster_;
  std::unique_ptr<LoopCloser> closer_;        // null when loops are not wanted
  std::unique_ptr<Relocaliser> relocaliser_;  // likewise: it works with the closer's index
  std::uint64_t saved_revision_ = 0;          // saver thread, then stop()
  std::unique_ptr<StatusServer> http_;
  std::jthread inserter_, saver_;
  std::vector<std::jthread> mappers_;
  const Stopwatch started_;
  bool stopped_ = false;
};

}  // namespace cairn
