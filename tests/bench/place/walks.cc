#include "tests/bench/place/walks.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include "common/feature/extract_features.h"
#include "common/model/trajectory.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::bench {
namespace {

namespace fs = std::filesystem;

fs::path data_folder() {
  const char* data = std::getenv("CAIRN_DATA");
  return data ? data : CAIRN_SOURCE_DIR "/../shared/data";
}

cv::Mat thinned(const cv::Mat& depth) {
  cv::Mat thin(depth.rows / View::kDepthStep, depth.cols / View::kDepthStep, CV_32FC1);
  for (int y = 0; y < thin.rows; ++y)
    for (int x = 0; x < thin.cols; ++x)
      thin.at<float>(y, x) = depth.at<float>(y * View::kDepthStep, x * View::kDepthStep);
  return thin;
}

// Share of `a`'s points with depth that `b` sees at about the depth where they are.
double seen_share(const PinholeCamera& camera, const View& a, const View& b) {
  const Rigid3 b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
  int known = 0, seen = 0;
  for (int y = 0; y < a.depth.rows; y += 5) {
    for (int x = 0; x < a.depth.cols; x += 5) {
      const double z = a.depth.at<float>(y, x);
      if (z <= 0) continue;
      ++known;
      const Eigen::Vector2d pixel(x * View::kDepthStep, y * View::kDepthStep);
      const Eigen::Vector3d p = b_from_a * camera.unproject(pixel, z);
      if (p.z() < 0.1) continue;
      const Eigen::Vector2d at = camera.project(p) / View::kDepthStep;
      if (at.x() < 0 || at.y() < 0 || at.x() >= b.depth.cols || at.y() >= b.depth.rows) continue;
      const float there = b.depth.at<float>(static_cast<int>(at.y()), static_cast<int>(at.x()));
      seen += there > 0 && std::abs(there - p.z()) < 0.1 * p.z();
    }
  }
  return known > 0 ? static_cast<double>(seen) / known : 0;
}

}  // namespace

double overlap(const PinholeCamera& camera, const View& a, const View& b) {
  return std::min(seen_share(camera, a, b), seen_share(camera, b, a));
}

Walk scene_walk(const std::string& scene, int path, int frames, int step) {
  const synthetic::SequenceOptions options{
      .scene = scene, .path = path, .frames = frames, .depth_noise = false};
  Walk walk{scene, {}, {}};
  const auto sequence = synthetic::SyntheticSequence::make(options);
  if (!sequence) return walk;
  walk.camera = {.fx = options.focal,
                 .fy = options.focal,
                 .cx = (options.width - 1) / 2.0,
                 .cy = (options.height - 1) / 2.0,
                 .width = options.width,
                 .height = options.height};
  for (int i = 0; i < (*sequence)->size(); i += step) {
    const auto frame = (*sequence)->frame(i);
    walk.views.push_back({static_cast<double>(frame.stamp_ns) * 1e-9, frame.world_from_camera,
                          extract_features(frame.gray).descriptors, thinned(frame.depth)});
  }
  return walk;
}

std::optional<Walk> kitchen_walk(int step) {
  const fs::path folder = data_folder() / "sevenscenes_kitchen_400";
  const auto truth = read_trajectory((folder / "groundtruth.txt").string());
  if (!truth) return std::nullopt;
  constexpr std::size_t kFrames = 400;  // the truth goes on beyond the images
  Walk walk{"7-Scenes kitchen",
            {.fx = 585, .fy = 585, .cx = 320, .cy = 240, .width = 640, .height = 480},
            {}};
  for (std::size_t i = 0; i < std::min(truth->size(), kFrames);
       i += static_cast<std::size_t>(step)) {
    const cv::Mat gray =
        cv::imread(folder / "rgb" / fmt::format("{:06}.jpg", i), cv::IMREAD_GRAYSCALE);
    const cv::Mat millimetres =
        cv::imread(folder / "depth" / fmt::format("{:06}.png", i), cv::IMREAD_UNCHANGED);
    if (gray.empty() || millimetres.empty()) return std::nullopt;
    cv::Mat depth;
    millimetres.convertTo(depth, CV_32F, 1e-3);
    depth.setTo(0, depth > 10);  // 65535: unknown
    const StampedPose& pose = (*truth)[i];
    walk.views.push_back({static_cast<double>(pose.stamp_ns) * 1e-9, pose.world_from_camera,
                          extract_features(gray).descriptors, thinned(depth)});
  }
  return walk;
}

std::string photos_folder() {
  return (data_folder() / "photos").string();
}

}  // namespace cairn::bench
