#include "server/mapping/local_mapping.h"

#include <utility>

#include "common/util/clock.h"
#include "server/mapping/sightings.h"

namespace cairn {
namespace {

// Milliseconds since the last call.
double lap(Stopwatch& watch) {
  const double ms = watch.milliseconds();
  watch.reset();
  return ms;
}

}  // namespace

LocalMapping::LocalMapping(MapWriter& writer, LocalSolver solver,
                           const LocalMappingOptions& options)
    : writer_(writer), solver_(std::move(solver)), options_(options) {}

DeltaSummary LocalMapping::submit(MapDelta delta) {
  if (delta.empty()) return {};
  return writer_.submit(std::move(delta)).delta;
}

LocalMappingReport LocalMapping::map_keyframe(KeyframeId id, std::size_t backlog,
                                              std::stop_token stop) {
  LocalMappingReport report;
  report.found = writer_.snapshot()->keyframes.contains(id);
  Stopwatch total;
  unsolved_.push_back(id);
  if (report.found) extend(id, report);
  const bool now = backlog == 0 || unsolved_.size() >= options_.max_coalesced;
  if (now && !stop.stop_requested()) {
    solve(report, stop);
    if (report.found) cull_around(id, report);
  }
  report.total_ms = total.milliseconds();
  return report;
}

void LocalMapping::fuse_with_neighbours(KeyframeId id, FuseDirection direction,
                                        LocalMappingReport& report) {
  Stopwatch watch;
  const DeltaSummary fused =
      submit(fuse(*writer_.snapshot(), id, grids_, options_.fuse, direction));
  report.observations_added += fused.observations_added;
  report.fused += fused.fused;
  report.fuse_ms += watch.milliseconds();
}

void LocalMapping::extend(KeyframeId id, LocalMappingReport& report) {
  Stopwatch watch;
  report.landmarks_culled =
      submit(cull_landmarks(*writer_.snapshot(), id, options_.cull)).landmarks_removed;
  report.cull_landmarks_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kInto, report);
  watch.reset();
  report.landmarks_made =
      submit(triangulate(*writer_.snapshot(), id, grids_, options_.triangulate)).landmarks_made;
  report.triangulate_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kFrom, report);
  watch.reset();
  submit(count_sightings(*writer_.snapshot(), id, grids_, options_.sighting_neighbours));
  report.sightings_ms = lap(watch);
}

void LocalMapping::cull_around(KeyframeId id, LocalMappingReport& report) {
  Stopwatch watch;
  report.keyframes_culled =
      submit(cull_keyframes(*writer_.snapshot(), id, options_.cull)).keyframes_removed;
  report.cull_keyframes_ms = watch.milliseconds();
}

void LocalMapping::solve(LocalMappingReport& report, std::stop_token stop) {
  Stopwatch watch;
  const Snapshot map = writer_.snapshot();
  const LocalWindow window = choose_local_window(*map, unsolved_, options_.window);
  report.window_ms = lap(watch);
  report.solved = solver_ && !window.free_keyframes.empty();
  MapDelta delta = report.solved ? solver_(*map, window, stop) : MapDelta::based_on(*map);
  // With the result, so that a saved map never has the one without the other.
  delta.mapped_keyframes = std::exchange(unsolved_, {});
  submit(std::move(delta));
  report.solve_ms = lap(watch);
}

}  // namespace cairn
