#include "server/optimize/local_ba.h"

#include "common/util/clock.h"

namespace cairn {

MapDelta solve_local_ba(const Map& snapshot, const LocalWindow& window,
                        const LocalBaOptions& options, LocalBaSummary* summary,
                        std::stop_token stop) {
  const Stopwatch watch;
  BundleProblem problem =
      extract_bundle(snapshot, window.free_keyframes, window.fixed_keyframes, window.landmarks);
  const double extract_ms = watch.milliseconds();
  BundleSummary result = solve_bundle(problem, options.bundle, std::move(stop));
  result.extract_ms = extract_ms;
  if (summary) *summary = result;
  if (result.usable && result.observations > 0 && result.keyframes > 0)
    return bundle_delta(snapshot, problem);
  MapDelta nothing;
  nothing.base_revision = snapshot.revision;
  nothing.base_merge_epoch = snapshot.merge_epoch;
  return nothing;
}

}  // namespace cairn
