// The client's connection to the server, and the only thing of it that client main sees.
//
// A keyframe given to send() is written to the outbox file before it goes out and leaves it when
// the server has journaled it: nothing is lost when the link, the server or this process ends.
// Keyframes that an earlier run left in the file are delivered first.
//
// send() and poll_update() take microseconds and never wait for disk or network: call them from the
// tracking thread at every frame. All members are safe from any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "common/model/ids.h"
#include "common/model/keyframe.h"
#include "common/model/map_update.h"
#include "common/model/relocalise.h"
#include "common/util/status.h"

namespace cairn {

struct LinkOptions {
  ClientId client;
  Sensor sensor = Sensor::kRgbd;
  std::uint32_t domain = 0;
  std::string partition = "cairn";  // the deployment's name
  std::filesystem::path outbox;     // made when missing, removed by stop() when all is delivered
  bool no_server = false;           // only fill the outbox; DDS is never started
  // The server answers a keyframe only after all that follows from it (loops, global adjustment).
  bool lockstep = false;
  std::string dds_config;  // XML instead of what CYCLONEDDS_URI names
};

struct LinkStats {
  bool connected = false;  // the server has answered within the last seconds
  // When it answered last; it does so at least once a second. The clock's epoch: never.
  std::chrono::steady_clock::time_point heard{};
  std::uint64_t keyframes_made = 0;   // given to send() in this run
  std::uint64_t keyframes_acked = 0;  // of any run
  std::uint64_t keyframes_in_outbox =
      0;  // not acknowledged yet, those on their way to disk included
  std::uint64_t bytes_up = 0, bytes_down = 0;  // blobs written and received, repeats included
  std::uint64_t resends = 0;          // times that unacknowledged keyframes were sent again
  std::uint64_t updates = 0;          // handed over by poll_update()
  std::uint64_t refreshes_asked = 0;  // after a gap in the updates
  std::uint64_t questions = 0;        // sent by ask()
};

class Link {
 public:
  // Opens the outbox and starts the threads; does not wait for a server.
  // kInvalidArgument: unusable name. kCorrupt, kVersion: the outbox file is none of ours or
  // damaged. kUnavailable: the outbox is in use, or DDS does not start.
  static Result<std::unique_ptr<Link>> start(const LinkOptions& options);
  ~Link();  // stop()
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // Sequences must count up from 0 in this run.
  void send(KeyframePtr keyframe);

  // The oldest update not yet taken. Its base_revision is the revision of the one before it, or 0
  // for a full refresh.
  std::optional<MapUpdate> poll_update();
  std::optional<MapUpdate> wait_update(std::chrono::nanoseconds timeout, std::stop_token stop = {});

  // Asks the server where a view lies (see RelocaliseAnswer); a newer question takes the place of
  // one that is still waiting. At once, like send(); without a server nothing happens.
  void ask(KeyframePtr view);
  // The latest answer, if it has not been taken.
  std::optional<RelocaliseAnswer> poll_answer();
  std::optional<RelocaliseAnswer> wait_answer(std::chrono::nanoseconds timeout,
                                              std::stop_token stop = {});

  LinkStats stats() const;
  // Not ok when the server refuses this client for good (kUnavailable, the server's words), or the
  // outbox cannot be written. Tracking may go on; delivery does not.
  Status status() const;

  // True when every keyframe has been acknowledged; false after `timeout`, when a stop is asked
  // for, without a server, or once status() is not ok.
  bool wait_delivered(std::chrono::nanoseconds timeout, std::stop_token stop = {});

  // Tells the server that no keyframe will follow, so that it makes the last corrections; the
  // update with MapUpdate::settled says that they are in.
  void say_finishing();

  // Writes what is left to the outbox, says goodbye, ends the threads; within about 2 s, or 5 s
  // when the network hangs. Removes the outbox file when it is empty. Safe to call twice.
  void stop();

 private:
  struct Parts;
  explicit Link(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

}  // namespace cairn
