// Follows the features of one image, the reference, through the images after it, while there is no
// map yet to track against: where a monocular camera waits for parallax.
#pragma once

#include <cstdint>
#include <vector>

#include "common/feature/feature_grid.h"
#include "common/model/features.h"

namespace cairn {

struct FeatureMatch;

// Feature `reference` of the reference image is seen again as `feature`.
struct StartTrack {
  std::uint16_t reference = 0, feature = 0;
};

class StartTracks {
 public:
  explicit StartTracks(Features reference);

  // Finds the reference's features in the next image, each around where it was seen last, by what
  // it looked like in the reference or looked like last; at most one track a feature, ascending by
  // reference. A feature that is missed is looked for again in the images after.
  std::vector<StartTrack> follow(const Features& features, const FeatureGrid& grid);

  const Features& reference() const { return reference_; }

 private:
  // A feature of the reference as it was seen last.
  struct Sight {
    float x = 0, y = 0;
    Descriptor descriptor{};
  };

  std::vector<StartTrack> take(const std::vector<FeatureMatch>& matches, const Features& features);

  Features reference_;
  std::vector<Sight> sights_;      // one a feature of the reference
  float flow_x_ = 0, flow_y_ = 0;  // median motion between the last two images, pixels
};

}  // namespace cairn
