#include "client/frontend/frontend.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <utility>

#include "client/frontend/undistort_map.h"

namespace cairn {
namespace {

Rig make_rig(const CameraConfig& config, const FrontendOptions& options) {
  double baseline = 0, max_depth = 0;
  if (config.sensor == Sensor::kStereo) {
    baseline = config.baseline_m;
    max_depth = options.max_depth_baselines * baseline;
  } else if (config.sensor == Sensor::kRgbd) {
    // The imagined second camera whose disparity of one pixel is as uncertain as the depth:
    // sigma_z = z^2 / (fx baseline) sigma_d.
    baseline = 1.0 / (config.camera.intrinsics()[0] * options.depth_error_m);
    max_depth = options.max_depth_m;
  }
  return {.sensor = config.sensor,
          .camera = config.camera.ideal(baseline),
          .pyramid = options.extractor.pyramid,
          .max_depth = max_depth};
}

StereoOptions stereo_options(const Rig& rig, const FrontendOptions& options) {
  StereoOptions stereo = options.stereo;
  if (stereo.max_disparity <= 0)
    stereo.max_disparity = static_cast<float>(rig.camera.fx / options.min_depth_baselines);
  return stereo;
}

// Depth is read at the pixel as seen, before undistortion: the depth image has the same lens.
void set_disparity_from_depth(const cv::Mat& depth, const PinholeCamera& camera,
                              Features& features) {
  for (Feature& f : features.points) {
    const int x = static_cast<int>(std::lround(f.x)), y = static_cast<int>(std::lround(f.y));
    if (x < 0 || y < 0 || x >= depth.cols || y >= depth.rows) continue;
    const float z = depth.at<float>(y, x);
    if (std::isfinite(z) && z > 0) f.disparity = static_cast<float>(camera.disparity(z));
  }
}

void undistort(const UndistortMap& map, Features& features) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const auto ideal = map.undistort(features.points[i].x, features.points[i].y);
    if (!ideal) continue;
    features.points[kept] = features.points[i];
    features.points[kept].x = ideal->x();
    features.points[kept].y = ideal->y();
    features.descriptors[kept] = features.descriptors[i];
    ++kept;
  }
  features.points.resize(kept);
  features.descriptors.resize(kept);
}

}  // namespace

class Frontend::Implementation {
 public:
  Implementation(const CameraConfig& config, const FrontendOptions& options)
      : rig(make_rig(config, options)),
        left(options.extractor),
        undistort_map_(config.camera),
        threads_(options.threads),
        right_(options.extractor),
        stereo_(stereo_options(rig, options)) {}

  ObservedFrame process(const Frame& frame) {
    ObservedFrame out{.stamp_ns = frame.stamp_ns, .features = {}};
    const auto capacity = static_cast<std::size_t>(capacity_);
    out.features.points.reserve(capacity);
    out.features.descriptors.reserve(capacity);
    if (rig.sensor == Sensor::kStereo && !frame.right.empty())
      extract_pair(frame, out.features);
    else
      left.extract(frame.gray, out.features);
    if (rig.sensor == Sensor::kRgbd && frame.depth.type() == CV_32FC1)
      set_disparity_from_depth(frame.depth, rig.camera, out.features);
    capacity_ = std::max(capacity_, out.features.size());
    undistort(undistort_map_, out.features);
    return out;
  }

  const Rig rig;
  Extractor left;

 private:
  void extract_pair(const Frame& frame, Features& features) {
    if (threads_ > 1) {
      const auto right =
          std::async(std::launch::async, [&] { right_.extract(frame.right, right_features_); });
      left.extract(frame.gray, features);
      right.wait();
    } else {
      left.extract(frame.gray, features);
      right_.extract(frame.right, right_features_);
    }
    stereo_.match(left.pyramid(), right_.pyramid(), right_features_, features);
  }

  UndistortMap undistort_map_;
  int threads_;
  Extractor right_;
  Features right_features_;
  StereoMatcher stereo_;
  std::size_t capacity_ = 0;  // features of the richest frame so far
};

Frontend::Frontend(const CameraConfig& config, const FrontendOptions& options)
    : implementation_(std::make_unique<Implementation>(config, options)) {}
Frontend::~Frontend() = default;

ObservedFrame Frontend::process(const Frame& frame) {
  return implementation_->process(frame);
}
const Rig& Frontend::rig() const {
  return implementation_->rig;
}
const ExtractorStats& Frontend::stats() const {
  return implementation_->left.stats();
}
double Frontend::scene_entropy() const {
  return implementation_->left.scene_entropy();
}

}  // namespace cairn
