#include "client/tracking/refine.h"

#include "client/tracking/noise_level.h"
#include "client/tracking/pose_solver.h"

namespace cairn {
namespace {

constexpr double kSuddenly = 2;  // times less precise than the bound of this camera's views fits

}  // namespace

int refine_pose(TrackedFrame& frame) {
  std::vector<PoseObservation> observations;
  std::vector<std::size_t> feature_of;
  for (std::size_t f = 0; f < frame.matches.size(); ++f) {
    if (!frame.matches[f].matched) continue;
    const Feature& feature = frame.features.points[f];
    observations.push_back({frame.matches[f].position, feature.pixel(), feature.disparity,
                            measurement_sigma(*frame.rig, feature)});
    feature_of.push_back(f);
  }
  const auto solve = [&](double slack) {
    return solve_pose(frame.rig->camera, frame.map_from_camera, observations, slack);
  };
  PoseSolution solution = solve(frame.slack);
  // Far worse than the views before it, by a blow to the camera perhaps.
  const bool is_worse = 2 * static_cast<std::size_t>(solution.inliers) < observations.size() ||
                        slack_of(solution.median_squared) > kSuddenly * frame.slack;
  if (frame.slack < 1 && is_worse) solution = solve(1);
  frame.map_from_camera = solution.map_from_camera;
  if (solution.inliers > 0) frame.median_squared = solution.median_squared;
  int landmarks = 0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    FeatureMatch& match = frame.matches[feature_of[i]];
    if (!solution.is_inlier[i]) match = {};
    landmarks += match.shows_landmark();
  }
  return landmarks;
}

}  // namespace cairn
