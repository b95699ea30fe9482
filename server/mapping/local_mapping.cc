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

// Loops come seconds apart at the most, so that the second attempt is as good as sure.
DeltaSummary LocalMapping::submit(const Step& step) {
  constexpr int kAttempts = 5;
  DeltaSummary summary;
  for (int i = 0; i < kAttempts; ++i) {
    MapDelta delta = step(*writer_.snapshot());
    if (delta.empty()) return {};
    summary = writer_.submit(std::move(delta)).delta;
    if (!summary.is_void) break;
  }
  return summary;
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
      submit([&](const Map& map) { return fuse(map, id, grids_, options_.fuse, direction); });
  report.observations_added += fused.observations_added;
  report.fused += fused.fused;
  report.fuse_ms += watch.milliseconds();
}

void LocalMapping::extend(KeyframeId id, LocalMappingReport& report) {
  Stopwatch watch;
  report.landmarks_culled = submit([&](const Map& map) {
                              return cull_landmarks(map, id, options_.cull);
                            }).landmarks_removed;
  report.cull_landmarks_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kInto, report);
  watch.reset();
  report.landmarks_made = submit([&](const Map& map) {
                            return triangulate(map, id, grids_, options_.triangulate);
                          }).landmarks_made;
  report.triangulate_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kFrom, report);
  watch.reset();
  submit([&](const Map& map) {
    return count_sightings(map, id, grids_, options_.sighting_neighbours);
  });
  report.sightings_ms = lap(watch);
}

void LocalMapping::cull_around(KeyframeId id, LocalMappingReport& report) {
  Stopwatch watch;
  report.keyframes_culled = submit([&](const Map& map) {
                              return cull_keyframes(map, id, options_.cull);
                            }).keyframes_removed;
  report.cull_keyframes_ms = watch.milliseconds();
}

void LocalMapping::solve(LocalMappingReport& report, std::stop_token stop) {
  Stopwatch watch;
  submit([&](const Map& map) {
    const LocalWindow window = choose_local_window(map, unsolved_, options_.window);
    report.window_ms += lap(watch);
    report.solved = solver_ && !window.free_keyframes.empty();
    MapDelta delta = report.solved ? solver_(map, window, stop) : MapDelta::based_on(map);
    // With the result, so that a saved map never has the one without the other.
    delta.mapped_keyframes = unsolved_;
    return delta;
  });
  unsolved_.clear();
  report.solve_ms = lap(watch);
}

}  // namespace cairn
