// Tells clients that don't know where they are: from the whole map, everyone's part of it.
//
//   words -> index -> candidates -> locate (server/verify) -> the place that is alone -> answer
//
// A thread of its own, on snapshots and the index that loop closing keeps: it waits for no mapping,
// loop or adjustment. Of each client only the latest view is looked at; the clients have their
// turns.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "common/model/relocalise.h"
#include "server/map/map_writer.h"
#include "server/place/loop_candidates.h"
#include "server/place/vocabulary.h"
#include "server/verify/relocalise.h"

namespace cairn {

struct RelocaliseOptions {
  // Wider than for loops: a view has no neighbours that could tell how alike a place must look.
  CandidateOptions candidates{.group_share = 0.5, .most = 15};
  // Of which so many are held against the view, without those that show what one of the others was
  // found to show.
  int most_held = 4;
  LocateOptions locate;
  // Another place of the same part of the map, farther off than this (metres, or a share of a
  // landmark's usual distance where that is more; radians), must not explain more than this share
  // of what the best one does.
  double rival_shift = 0.5, rival_turn = 0.35;
  double max_rival = 0.5;
  // Told around the answer, some 90 bytes each: enough to track by until the next map update comes.
  std::size_t landmarks = 500;
};

// The answer to one view; without the run's epoch where the view has none. Works on the snapshot
// alone, in any thread. The same input gives the same answer.
RelocaliseAnswer relocalise(const Map& map, const PlaceIndex& index, const Vocabulary& vocabulary,
                            const Keyframe& view, const RelocaliseOptions& options);

class Relocaliser {
 public:
  // How long an answer took, the wait for its turn included.
  using Send = std::function<void(const ClientId&, const RelocaliseAnswer&, double milliseconds)>;

  // All given must outlive this. Nothing is answered before start().
  Relocaliser(const MapWriter& writer, const PlaceIndex& index,
              std::shared_ptr<const Vocabulary> vocabulary, const RelocaliseOptions& options = {});
  ~Relocaliser();  // close()
  Relocaliser(const Relocaliser&) = delete;
  Relocaliser& operator=(const Relocaliser&) = delete;

  // `send` is called from the thread.
  void start(Send send);

  // Where does the view lie? From any thread, at once; takes the place of the client's question
  // that still waits.
  void ask(const ClientId& client, KeyframePtr view);
  // Nobody waits for an answer any more.
  void forget(const ClientId& client);

  // Ends after the answer at hand; what waits is dropped.
  void close();

 private:
  struct Question {
    KeyframePtr view;
    std::chrono::steady_clock::time_point asked;
  };
  void run(std::stop_token stop);

  const MapWriter& writer_;
  const PlaceIndex& index_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const RelocaliseOptions options_;

  std::mutex mutex_;
  std::condition_variable_any asked_;
  std::map<ClientId, Question> waiting_;
  std::deque<ClientId> turns_;  // of those that wait

  Send send_;
  std::jthread thread_;
};

}  // namespace cairn
