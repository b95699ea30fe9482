// Local bundle adjustment for all clients together: which keyframes wait for it, which of them one
// solve serves, and that no two threads that ask here solve for the same keyframe at a time.
//
// A keyframe comes here once the other steps of local mapping are done (local_mapping.h). Whoever
// has brought one, or has told a client of the result, asks for work; a keyframe whose
// neighbourhood another thread is solving waits for that thread, which finds it when it asks again.
// So keyframes that come close together, from one client or from several that are at the same
// place, share a solve, and clients at different places don't wait for each other.
//
// While more keyframes come, who could solve prepares one of those first, until enough wait to
// share a solve; and while many come windows are smaller. No keyframe is left out.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <set>
#include <stop_token>
#include <vector>

#include "server/map/map_writer.h"
#include "server/map/window.h"
#include "server/mapping/cull.h"
#include "server/mapping/local_window.h"

namespace cairn {

// Solves for the free keyframes and the landmarks of the window; based on the given map. Returns
// early, with what it has, when asked to stop.
using LocalSolver =
    std::function<MapDelta(const Map& map, const LocalWindow& window, std::stop_token stop)>;

struct LocalAdjusterOptions {
  LocalWindowOptions window = {};
  CullOptions cull = {};
  std::size_t max_together = 6;  // keyframes that one solve serves
  // While more keyframes than this wait, for the steps before or here, windows are smaller: by as
  // much as there are more, down to a quarter.
  std::size_t thin_from = 4;
};

// What one solve has done; no keyframes: there was nothing to do.
struct LocalAdjustment {
  std::vector<KeyframeId> keyframes;  // count as mapped from here on, in order of their arrival
  bool solved = false;                // false: nothing in the map to solve for
  double window_ms = 0, solve_ms = 0, cull_ms = 0;  // waiting for the writer included
  int keyframes_culled = 0;
};

// All members are safe from any thread.
class LocalAdjuster {
 public:
  // `writer` must outlive this. Without a solver keyframes only count as mapped.
  LocalAdjuster(MapWriter& writer, LocalSolver solver, const LocalAdjusterOptions& options = {});

  // The keyframe waits for its adjustment from here on.
  void add(KeyframeId id);

  // Adjusts around the keyframe that has waited longest, of those that can be served now, then
  // takes out what has become redundant there. `more_coming`: keyframes that are still to be
  // added: with some, and less than `max_together` waiting, nothing is done. Whoever adds them will
  // ask again.
  LocalAdjustment adjust(std::size_t more_coming, std::stop_token stop = {});

  std::size_t waiting() const;

 private:
  struct Claim {
    std::vector<KeyframeId> centres;
    std::set<KeyframeId> region;  // nobody else solves for these meanwhile
    LocalWindowOptions window;
  };
  Claim claim(std::size_t more_coming);
  std::vector<KeyframeId> companions(const Map& map, KeyframeId centre,
                                     std::set<std::uint64_t> without) const;
  bool is_free(const std::vector<KeyframeId>& keyframes) const;
  void release(const Claim& claim);

  MapWriter& writer_;
  const LocalSolver solver_;
  const LocalAdjusterOptions options_;
  mutable std::mutex mutex_;
  std::deque<KeyframeId> waiting_;  // in order of arrival
  std::set<KeyframeId> busy_;       // being solved for
  std::set<std::uint64_t> runs_;    // of the centres that are being solved for: in order, one run
                                    // waits for its own solve
};

}  // namespace cairn
