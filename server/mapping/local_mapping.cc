#include "server/mapping/local_mapping.h"

#include "common/util/clock.h"
#include "server/mapping/sightings.h"
#include "server/mapping/step.h"

namespace cairn {

LocalMapping::LocalMapping(MapWriter& writer, const LocalMappingOptions& options)
    : writer_(writer), options_(options) {}

void LocalMapping::fuse_with_neighbours(KeyframeId id, FuseDirection direction,
                                        LocalMappingReport& report) {
  Stopwatch watch;
  const DeltaSummary fused = take_step(
      writer_, [&](const Map& map) { return fuse(map, id, grids_, options_.fuse, direction); });
  report.observations_added += fused.observations_added;
  report.fused += fused.fused;
  report.fuse_ms += watch.milliseconds();
}

LocalMappingReport LocalMapping::extend(KeyframeId id) {
  LocalMappingReport report;
  report.found = writer_.snapshot()->keyframes.contains(id);
  if (!report.found) return report;
  Stopwatch total, watch;
  report.landmarks_culled = take_step(writer_, [&](const Map& map) {
                              return cull_landmarks(map, id, options_.cull);
                            }).landmarks_removed;
  report.cull_landmarks_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kInto, report);
  watch.reset();
  report.landmarks_made = take_step(writer_, [&](const Map& map) {
                            return triangulate(map, id, options_.triangulate);
                          }).landmarks_made;
  report.triangulate_ms = lap(watch);

  fuse_with_neighbours(id, FuseDirection::kFrom, report);
  watch.reset();
  take_step(writer_, [&](const Map& map) {
    return count_sightings(map, id, grids_, options_.sighting_neighbours);
  });
  report.sightings_ms = lap(watch);
  report.total_ms = total.milliseconds();
  return report;
}

}  // namespace cairn
