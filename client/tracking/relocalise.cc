#include "client/tracking/relocalise.h"

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "client/tracking/frame_matcher.h"
#include "client/tracking/refine.h"

namespace cairn {
namespace {

constexpr int kMinMatches = 15;  // by looks; fewer make RANSAC a lottery
constexpr int kMinConsensus = 10;
constexpr int kRansacIterations = 200;
constexpr float kRansacPixels = 5.0f;
constexpr double kConfidence = 0.99;
constexpr std::size_t kKeyframesAround = 20;
constexpr double kSearchRadius = 3.0;  // see match_to_landmarks

// Pose by consensus; unmatches what is not part of it.
bool solve_by_consensus(TrackedFrame& frame) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  std::vector<std::size_t> feature_of;
  for (std::size_t f = 0; f < frame.matches.size(); ++f) {
    if (!frame.matches[f].matched) continue;
    const Eigen::Vector3d& p = frame.matches[f].position;
    points.emplace_back(p.x(), p.y(), p.z());
    pixels.emplace_back(frame.features.points[f].x, frame.features.points[f].y);
    feature_of.push_back(f);
  }
  const PinholeCamera& c = frame.rig->camera;
  const cv::Matx33d k(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
  cv::Vec3d rotation, translation;
  std::vector<int> consensus;
  // OpenCV's generator is per thread and starts where it was left: the same seed for the same
  // answer.
  cv::theRNG().state = 0x9e3779b9;
  try {
    if (!cv::solvePnPRansac(points, pixels, k, cv::noArray(), rotation, translation, false,
                            kRansacIterations, kRansacPixels, kConfidence, consensus,
                            cv::SOLVEPNP_AP3P))
      return false;
  } catch (const cv::Exception&) {
    return false;  // degenerate samples, such as points on a line
  }
  if (consensus.size() < kMinConsensus) return false;

  std::vector<FeatureMatch> kept(frame.matches.size());
  for (const int i : consensus) {
    const std::size_t f = feature_of[static_cast<std::size_t>(i)];
    kept[f] = frame.matches[f];
  }
  frame.matches = std::move(kept);
  const Rigid3 camera_from_map(so3_exp({rotation[0], rotation[1], rotation[2]}),
                               {translation[0], translation[1], translation[2]});
  frame.map_from_camera = camera_from_map.inverse();
  return frame.map_from_camera.is_finite();
}

}  // namespace

bool relocalise_against(const Keyframe& keyframe, LocalMap& map, int min_inliers,
                        TrackedFrame& frame) {
  frame.clear_matches();
  const bool found = match_to_keyframe(keyframe, map, frame) >= kMinMatches &&
                     solve_by_consensus(frame) && refine_pose(frame) >= kMinConsensus;
  if (found) {
    const std::vector<LandmarkId> shown = frame.landmarks();
    match_to_landmarks(map.around(shown, kKeyframesAround), kSearchRadius, frame);
    if (refine_pose(frame) >= min_inliers) return true;
  }
  frame.clear_matches();
  return false;
}

}  // namespace cairn
