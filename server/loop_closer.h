// Closing loops and merging parts, beside mapping: what every keyframe goes through once it is
// mapped.
//
//   words -> index -> candidates -> verify -> correct -> fuse -> weld     (here, one thread)
//                                                              -> global BA (GlobalAdjuster)
//
// A verified candidate is one of three things. It agrees with the map but for a little: then the
// two sides only had not been connected, and fusing what both see is enough. It lies in the same
// part of the map: a loop, which a pose graph distributes. Or in another part: the younger part
// moves as a whole, and the two are one from then on.
//
// Scale: a part is measured in metres as soon as one of its keyframes is of a sensor with depth.
// Two such parts are held against each other, and loops in one are closed, with the scale as it is.
// Where a side has none the scale is sought as well: a part without one is what moves and is scaled
// when it meets one with, and loops inside of it distribute the drift in scale, too.
//
// Nothing here holds up ingest or mapping: every step works on a snapshot and sends an event to the
// map's writer.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <thread>

#include "common/util/status.h"
#include "server/global_adjuster.h"
#include "server/map/map_writer.h"
#include "server/mapping/fuse.h"
#include "server/mapping/local_adjuster.h"
#include "server/optimize/pose_graph.h"
#include "server/place/loop_candidates.h"
#include "server/place/vocabulary.h"
#include "server/verify/verify.h"

namespace cairn {

struct LoopCloserOptions {
  CandidateOptions candidates;
  VerifyOptions verify;
  PoseGraphOptions pose_graph;
  FuseOptions fuse;
  LocalWindowOptions window;
  GlobalBaOptions global_ba;
  // A loop that asks for less than this is no correction: what local adjustment can take up by
  // itself. Share of the median distance of what both sides see, radians, and logarithm of the
  // scale, where that is free.
  double small_shift_share = 0.01, small_turn = 0.005, small_scale = 0.02;
  // While more keyframes wait they only go into the index: recognition may miss one, mapping must
  // not starve.
  std::size_t max_waiting = 40;
  // So many candidates in the keyframe's own part of the map are verified, less one for each
  // keyframe that waits, here or to be mapped: a loop is seen again a little later, while a part
  // that nobody has merged is of no use to its client.
  std::size_t most_in_own_part = 3;
  std::size_t weld_neighbours = 5;  // of the query, whose landmarks are fused too
};

struct LoopCloserHooks {
  LocalSolver solve;  // local BA, for the weld
  // Keyframes that wait to be mapped. May be empty: none.
  std::function<std::size_t()> mapping_waits;
  // A correction has been applied: keeps the map as it was before, so that it can be undone.
  std::function<Status(const Map& before)> keep;
  // The map has changed by more than a little, or a run is settled: tell the clients. From any of
  // the threads here; must not block.
  std::function<void()> changed;
};

struct LoopCounters {
  std::atomic<std::uint64_t> recognised = 0;  // keyframes looked up
  std::atomic<std::uint64_t> candidates = 0, verified = 0;
  std::atomic<std::uint64_t> loops = 0, merges = 0, connected = 0, contradicted = 0;
};

class LoopCloser {
 public:
  // `writer` must outlive this. Keyframes that the map holds already go into the index first, in
  // the background.
  LoopCloser(MapWriter& writer, std::shared_ptr<const Vocabulary> vocabulary,
             const LoopCloserOptions& options, LoopCloserHooks hooks);
  ~LoopCloser();
  LoopCloser(const LoopCloser&) = delete;
  LoopCloser& operator=(const LoopCloser&) = delete;

  // A keyframe has been mapped. From any thread, at once.
  void offer(KeyframeId id);

  // The run has ended: closes what is left to close and, where the map has loops, adjusts the run's
  // part of it as a whole; settled(epoch) once that is done. From any thread, at once.
  void finish(std::uint64_t epoch);
  bool settled(std::uint64_t epoch) const;
  // The run is over and its client gone: nobody asks any more whether it is settled.
  void forget(std::uint64_t epoch);

  // Until all that was offered is dealt with, global adjustment included, or stop_adjusting(). For
  // runs that are to give the same every time.
  void wait_idle();
  // Global adjustment ends without a result, and nobody waits for it any more.
  void stop_adjusting() { adjuster_.stop(); }

  // Finishes what has been offered, without starting another global adjustment.
  void close();

  const LoopCounters& counters() const { return counters_; }
  // What all keyframes that have been looked up look like; safe to query from any thread, without
  // waiting for what is under way here.
  const PlaceIndex& index() const { return index_; }
  const GlobalAdjuster& adjuster() const { return adjuster_; }

 private:
  struct Task {
    enum class Kind { kRecognise, kIndex, kFinish, kForget };
    Kind kind = Kind::kRecognise;
    KeyframeId keyframe;  // of the last two the epoch alone: the run
  };

  void run();
  void push(Task task);
  void carry_out(const Task& task, std::size_t waiting);
  void settle(std::uint64_t epoch);
  void on_adjusted(const std::vector<GlobalAdjuster::Ticket>& tickets);
  void index(const Map& map, KeyframeId id);
  void recognise(const Map& map, KeyframeId id, std::size_t waiting);
  void drop_culled(const Map& map);
  bool close_loop(const VerifiedLoop& loop);
  bool is_small(const Map& map, const VerifiedLoop& loop) const;
  LoopClosure merge(const Map& map, const VerifiedLoop& loop,
                    const std::vector<KeyframeId>& of_query,
                    const std::vector<KeyframeId>& of_candidate) const;
  std::optional<LoopClosure> distribute(const Map& map, const VerifiedLoop& loop,
                                        const std::vector<KeyframeId>& part);
  void connect(const VerifiedLoop& loop);
  void weld(const VerifiedLoop& loop);

  MapWriter& writer_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const LoopCloserOptions options_;
  const LoopCloserHooks hooks_;
  LoopCounters counters_;

  PlaceIndex index_;  // which the recognising thread alone changes
  // The recognising thread's alone.
  std::set<KeyframeId> indexed_;                        // what it holds
  std::map<std::uint64_t, LoopCandidates> candidates_;  // by run
  GridCache grids_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Task> tasks_;
  bool busy_ = false, closed_ = false;
  std::map<GlobalAdjuster::Ticket, std::uint64_t> finishing_;  // runs by what they wait for
  std::set<std::uint64_t> settled_;                            // runs

  GlobalAdjuster adjuster_;
  std::jthread thread_;
};

}  // namespace cairn
