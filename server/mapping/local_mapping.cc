#include "server/mapping/local_mapping.h"

#include "common/util/clock.h"
#include "server/mapping/sightings.h"
#include "server/mapping/step.h"

namespace cairn {

LocalMapping::LocalMapping(MapWriter& writer, const LocalMappingOptions& options)
    : writer_(writer), options_(options) {}

LocalMappingReport LocalMapping::extend(KeyframeId id, std::size_t waiting) {
  LocalMappingReport report;
  report.found = writer_.snapshot()->keyframes.contains(id);
  if (!report.found) return report;
  Stopwatch total;
  FuseOptions fusing = options_.fuse;
  if (waiting > options_.hurry_from) {
    fusing.first /= 2;
    fusing.limit /= 2;
  }
  const DeltaSummary first = take_step(writer_, [&](const Map& map) {
    MapDelta delta = fuse(map, id, grids_, fusing, FuseDirection::kInto);
    delta.removed_landmarks = landmarks_failing_trial(map, id, options_.cull);
    return delta;
  });
  const DeltaSummary made = take_step(
      writer_, [&](const Map& map) { return triangulate(map, id, options_.triangulate); });
  const DeltaSummary last = take_step(writer_, [&](const Map& map) {
    MapDelta delta = fuse(map, id, grids_, fusing, FuseDirection::kFrom);
    delta.sightings =
        sightings(map, id, grids_, options_.sighting_neighbours, delta.fusions, options_.cull);
    return delta;
  });
  report.landmarks_culled = first.landmarks_removed;
  report.landmarks_made = made.landmarks_made;
  report.observations_added = first.observations_added + last.observations_added;
  report.fused = first.fused + last.fused;
  report.total_ms = total.milliseconds();
  return report;
}

}  // namespace cairn
