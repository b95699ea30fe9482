// The start of a monocular map: from one image on, the reference, features are followed until the
// camera has moved far enough for their depths to be told. Waits as long as it takes; when too few
// features are left, a newer image becomes the reference.
//
//   follow       the reference's features in the new image (start_tracks.h)
//   hypothesise  motions from an essential matrix and a homography (motion_hypotheses.h)
//   choose       for each motion, triangulate: which explains most features, in front of both
//                cameras and within their noise? That selects the model, too: on a plane the
//                homography's motions win, elsewhere the essential matrix's.
//   adjust       bundle adjustment of the best few over the images in between, which see the same
//                features: what two views leave open (a plane seen twice has two explanations),
//                more of them decide (small_bundle.h)
//   doubt        start only on enough points, enough parallax, and one explanation that is clearly
//                the best and stays the same from image to image
//
// After the ORB-SLAM paper (Mur-Artal et al. 2015, section IV); choosing the model by the points
// that follow from it, and the adjustment over all images, are Cairn's own.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "client/tracking/start_tracks.h"
#include "common/model/keyframe.h"

namespace cairn {

struct MonoStartOptions {
  // Features that a reference must have, and that must be found again.
  int min_features = 100;
  int min_tracks = 50;
  // Points that the map must start with, and the share of the followed features that they make.
  int min_points = 40;
  double min_share = 0.75;
  // Angle (radians) between the rays to a point that so many points must exceed: half of them, or
  // this many if that is less.
  double min_parallax = 0.0175;
  int parallax_points = 50;
  // How far the features must be, in the median, from where a camera that only turned would see
  // them: so many times what the explanation leaves unexplained. What is nearer could be a turn
  // through a lens that is not quite as calibrated.
  double min_beyond_turn = 3.5;
  // Images in a row that must tell of the same way.
  int steady_images = 3;
  // Another motion must explain the tracks so many times worse.
  double min_rival_score = 1.3;
  // What the median depth in the reference is called, in the map's unit: about a room's in metres,
  // for which thresholds are made.
  double median_depth = 2;
};

// What a map starts from. The reference's camera is the origin.
struct StartMap {
  struct Point {
    std::uint16_t reference = 0, feature = 0;  // in the reference image and in the latest one
    Eigen::Vector3d position;
  };
  struct Pose {
    std::int64_t stamp_ns = 0;
    Rigid3 reference_from_camera;
  };
  std::int64_t reference_stamp_ns = 0;
  Features reference;
  std::vector<Pose> poses;  // of all images since the reference, the latest one last
  std::vector<Point> points;
};

class MonoStart {
 public:
  MonoStart(std::shared_ptr<const Rig> rig, const MonoStartOptions& options);
  ~MonoStart();
  MonoStart(MonoStart&&) noexcept;
  MonoStart& operator=(MonoStart&&) noexcept;

  // The next image; nothing as long as the map can't start. Once it has, make another MonoStart for
  // another map. Costs a few milliseconds. Deterministic.
  std::optional<StartMap> add(std::int64_t stamp_ns, const Features& features,
                              const FeatureGrid& grid);

 private:
  class Attempt;
  struct Seen;

  void begin(std::int64_t stamp_ns, const Features& features);
  void thin_out();
  bool is_steady(const Eigen::Vector3d& way);

  std::shared_ptr<const Rig> rig_;
  MonoStartOptions options_;
  std::int64_t reference_stamp_ns_ = 0;
  std::optional<StartTracks> tracks_;
  std::vector<Seen> seen_;             // images since the reference
  std::vector<Eigen::Vector3d> ways_;  // to the latest images in a row, unit length
};

}  // namespace cairn
