// What a stage of mapping or a solver found out, as changes to make to the map. Computed from a
// snapshot, applied later by the map's writer (apply.h), when the map may have moved on: ids that
// are gone by then are skipped, and whatever contradicts the map's present state is dropped.
#pragma once

#include <cstdint>
#include <vector>

#include "server/map/map.h"

namespace cairn {

struct MapDelta {
  std::uint64_t base_revision = 0;  // of the snapshot that it was computed from
  std::uint32_t base_merge_epoch = 0;

  struct NewLandmark {
    Eigen::Vector3d position;               // in map
    std::vector<Observation> observations;  // the first one's keyframe becomes the reference
  };
  struct NewObservation {
    LandmarkId landmark;
    Observation observation;
  };
  struct Fusion {
    LandmarkId from, into;  // `from` ends; its observations go to `into`
  };
  struct PoseChange {
    KeyframeId keyframe;
    Rigid3 old_map_from_camera;  // in the snapshot: carries along what arrived since
    Rigid3 map_from_camera;
    // How many times as large as in the snapshot everything there is: by a loop or a merge of maps
    // without a scale of their own.
    double scale = 1;
  };
  struct PositionChange {
    LandmarkId landmark;
    Eigen::Vector3d position;  // in map
  };
  struct Sighting {  // adds to Landmark::visible and ::found
    LandmarkId landmark;
    std::uint32_t visible = 0, found = 0;
  };

  // Applied in this order.
  std::vector<LandmarkId> removed_landmarks;
  std::vector<NewLandmark> new_landmarks;
  std::vector<NewObservation> new_observations;
  std::vector<Fusion> fusions;
  std::vector<NewObservation> removed_observations;
  std::vector<PoseChange> poses;
  std::vector<PositionChange> positions;
  std::vector<Sighting> sightings;
  std::vector<KeyframeId> removed_keyframes;
  // Have been through local mapping, those with lower sequences of their runs included.
  std::vector<KeyframeId> mapped_keyframes;

  // An empty one, to be filled with what follows from this snapshot.
  static MapDelta based_on(const Map& snapshot);
  bool empty() const;
};

}  // namespace cairn
