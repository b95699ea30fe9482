// Frame -> features of the ideal camera, with depth: all that tracking sees of an image.
#pragma once

#include <cstdint>
#include <memory>

#include "client/capture/frame_source.h"
#include "client/frontend/extractor.h"
#include "client/frontend/stereo_match.h"
#include "common/config/camera_config.h"
#include "common/model/features.h"
#include "common/model/keyframe.h"

namespace cairn {

struct FrontendOptions {
  ExtractorOptions extractor = {};
  // RGB-D: standard deviation of a depth of one metre, in metres; it grows with the square of the
  // depth, as that of a stereo camera does. What counts is how well depth fits the image: noise,
  // calibration, registration and the offset between the two exposures together.
  double depth_error_m = 0.02;
  double max_depth_m = 3;           // RGB-D: Rig::max_depth
  double max_depth_baselines = 40;  // stereo: Rig::max_depth, in baselines
  double min_depth_baselines = 1;   // stereo: nothing nearer is looked for
  int threads = 1;                  // 2: left and right of a stereo pair at the same time
  StereoOptions stereo = {};        // max_disparity 0: fx / min_depth_baselines
};

// One moment as tracking sees it.
struct ObservedFrame {
  std::int64_t stamp_ns = 0;
  Features features;  // undistorted; disparity set where depth is known
};

// Used from one thread. Same frames in the same order, same result, on any number of threads.
class Frontend {
 public:
  explicit Frontend(const CameraConfig& config, const FrontendOptions& options = {});
  ~Frontend();
  Frontend(const Frontend&) = delete;
  Frontend& operator=(const Frontend&) = delete;

  // Frames are of the camera that the config describes (FrameSource sees to it). Features that the
  // lens model cannot undistort are left out. A missing right or depth image leaves depth unknown.
  ObservedFrame process(const Frame& frame);

  // What the features of all frames belong to.
  const Rig& rig() const;

  // Of the last frame (stereo: of the left image).
  const ExtractorStats& stats() const;
  // H_ave so far, in bits; see EntropyOptions::scene_mean.
  double scene_entropy() const;

 private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace cairn
