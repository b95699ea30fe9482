// Clients that send keyframes at a fixed pace and note when each is acknowledged.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "client/link/link.h"
#include "common/dds/participant.h"

namespace cairn::bench {

struct Acknowledged {
  std::chrono::system_clock::time_point due;  // when it was to be sent
  double milliseconds = 0;                    // from then until the acknowledgement was here
};

struct StreamOptions {
  std::string name;
  std::uint64_t number = 1;  // of the client: its place, its noise
  double keyframes_per_s = 4;
  int keyframes = 400;
  std::filesystem::path outbox;
  dds::ParticipantOptions dds;
};

// A client without images: keyframes of about 1000 features each, made beforehand, that go through
// the real outbox and link. What an acknowledgement costs is told from the time at which the
// keyframe was due, so that one that holds up the next ones counts for all of them.
class Stream {
 public:
  // Makes the keyframes; begins to send with start(). Error: the link can't be had.
  static Result<std::unique_ptr<Stream>> make(const StreamOptions& options);

  void start();
  // Ends sending; what was noted.
  std::vector<Acknowledged> stop();

 private:
  Stream(const StreamOptions& options, std::unique_ptr<Link> link);
  void run(std::stop_token stop);

  const StreamOptions options_;
  std::unique_ptr<Link> link_;
  std::vector<KeyframePtr> keyframes_;
  std::vector<Acknowledged> noted_;  // the thread's, until it has ended
  std::jthread thread_;
};

Result<std::unique_ptr<Link>> connect(const ClientId& client, const std::filesystem::path& outbox,
                                      const dds::ParticipantOptions& dds);

}  // namespace cairn::bench
