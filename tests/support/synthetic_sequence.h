// A camera recording of a synthetic scene, with exact poses. The whole of the embedded world in one
// call:
//
//   auto sequence = SyntheticSequence::make({.scene = "desk", .frames = 100});
//   SyntheticFrame frame = (*sequence)->frame(0);    // any index, in any order, from any thread
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "common/geometry/camera.h"
#include "common/model/keyframe.h"
#include "common/util/status.h"
#include "tests/support/renderer.h"
#include "tests/support/sensor_noise.h"
#include "tests/support/trajectory.h"

namespace cairn::synthetic {

struct SequenceOptions {
  std::string scene = "desk";
  int path = 0;            // which way through the scene
  std::uint64_t seed = 1;  // of the scene and the noise; the same for all that walk in one scene
  int frames = 0;          // 0: once round the path
  double rate_hz = 30;
  double start_s = 0;  // where on the path the first frame is taken
  Sensor sensor = Sensor::kRgbd;
  int width = 640, height = 480;
  double focal = 525;        // pixels, at 640 x 480; other sizes see the same angle
  double baseline_m = 0.11;  // stereo
  // Instead of the pinhole above; size and focal length are then its own.
  std::optional<Camera> camera = std::nullopt;
  // Shutter time; images are the average of `sub_exposures` moments spread over it. Unset: 20 ms
  // for the scene `turn`, else 0, no blur.
  std::optional<double> exposure_s = std::nullopt;
  int sub_exposures = 7;
  bool noise = true;  // of the grey images
  bool depth_noise = true;
  int threads = 1;  // that work on a frame
  // Frames black_from .. black_until-1 show nothing: a hand on the lens.
  int black_from = 0, black_until = 0;
  // From frame `jump_at` on (0: never) the camera is where it would be `jump_s` seconds later:
  // carried there unseen, if it is black before. Stamps go on as they were.
  int jump_at = 0;
  double jump_s = 0;
};

struct SyntheticFrame {
  std::int64_t stamp_ns = 0;
  cv::Mat gray;              // CV_8UC1
  cv::Mat right;             // CV_8UC1, stereo only
  cv::Mat depth;             // CV_32FC1 metres, 0 unknown, RGB-D only
  Rigid3 world_from_camera;  // of the left camera at the middle of the exposure, which is the stamp
};

// Immutable; frame() may be called from several threads.
class SyntheticSequence {
 public:
  // Errors: unknown scene, a number out of range.
  static Result<std::shared_ptr<const SyntheticSequence>> make(const SequenceOptions& options);

  const SequenceOptions& options() const { return options_; }
  const Camera& camera() const { return camera_; }
  const std::shared_ptr<const Scene>& scene() const { return scene_; }
  int size() const { return frames_; }
  std::int64_t stamp_ns(int index) const;
  Rigid3 world_from_camera(int index) const;
  SyntheticFrame frame(int index) const;

 private:
  SyntheticSequence(const SequenceOptions& options, Camera camera,
                    std::shared_ptr<const Scene> scene, const Trajectory& trajectory);

  double seconds(int index) const;
  double seconds_along_path(int index) const;
  bool is_black(int index) const;
  // The image of one camera (0: left, 1: right), averaged over the exposure, and the depth in the
  // middle of it.
  cv::Mat expose(int index, int camera, cv::Mat* depth) const;

  SequenceOptions options_;
  Camera camera_;
  std::shared_ptr<const Scene> scene_;
  Trajectory trajectory_;
  Renderer renderer_;
  SensorNoise noise_;
  double exposure_s_ = 0;
  int frames_ = 0;
};

}  // namespace cairn::synthetic
