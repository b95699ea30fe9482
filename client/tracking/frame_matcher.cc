#include "client/tracking/frame_matcher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <unordered_set>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

// Hamming distances out of 256. Of unrelated ORB descriptors hardly any two are nearer than 80 to
// each other, of one point in neighbouring frames most are nearer than 50 (Rublee et al. 2011, fig.
// 7).
constexpr int kMaxDistance = 100;        // where position and octave are checked as well
constexpr int kMaxDistanceByLooks = 50;  // where nothing else is
constexpr double kLocalRatio = 0.8;      // best against second best at the same octave
constexpr double kLooksRatio = 0.75;
constexpr double kMinViewCosine = 0.5;  // 60 degrees between the mean viewing direction and now

// A pair of landmark and feature that may become a match.
struct Candidate {
  std::size_t point = 0;  // index into the caller's points
  std::uint16_t feature = 0;
  int distance = std::numeric_limits<int>::max();
  float turned = 0;  // orientation in the frame minus where it was seen before, radians
};

struct Nearest {
  int best = std::numeric_limits<int>::max(), second = std::numeric_limits<int>::max();
  int best_octave = -1, second_octave = -1;
  std::uint16_t feature = 0;
};

Nearest nearest_feature(const Descriptor& descriptor, const TrackedFrame& frame,
                        std::span<const std::uint16_t> among) {
  Nearest n;
  for (const std::uint16_t f : among) {
    const int distance = hamming_distance(descriptor, frame.features.descriptors[f]);
    const int octave = frame.features.points[f].octave;
    if (distance < n.best) {
      n.second = n.best;
      n.second_octave = n.best_octave;
      n.best = distance;
      n.best_octave = octave;
      n.feature = f;
    } else if (distance < n.second) {
      n.second = distance;
      n.second_octave = octave;
    }
  }
  return n;
}

// Keeps, for each feature, the candidate that looks most like it.
std::vector<Candidate> best_per_feature(const std::vector<Candidate>& candidates,
                                        std::size_t features) {
  std::vector<int> owner(features, -1);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    int& o = owner[candidates[i].feature];
    if (o < 0 || candidates[i].distance < candidates[static_cast<std::size_t>(o)].distance)
      o = static_cast<int>(i);
  }
  std::vector<Candidate> kept;
  for (const int o : owner)
    if (o >= 0) kept.push_back(candidates[static_cast<std::size_t>(o)]);
  return kept;
}

// A camera that rolls turns all features alike: keeps the candidates in the three fullest of 30
// bins of 12 degrees, the second and third only where they hold at least a tenth of the first
// (the consistency check of the ORB-SLAM paper, section V).
void keep_consistently_turned(std::vector<Candidate>& candidates) {
  constexpr int kBins = 30;
  const auto bin_of = [](float turned) {
    const double full_turns = turned / (2 * M_PI);
    const int bin = static_cast<int>((full_turns - std::floor(full_turns)) * kBins + 0.5);
    return bin % kBins;
  };
  std::array<int, kBins> count{};
  for (const Candidate& c : candidates) ++count[static_cast<std::size_t>(bin_of(c.turned))];
  std::array<int, kBins> order{};
  for (int i = 0; i < kBins; ++i) order[static_cast<std::size_t>(i)] = i;
  const auto count_of = [&](int bin) { return count[static_cast<std::size_t>(bin)]; };
  std::stable_sort(order.begin(), order.end(),
                   [&](int a, int b) { return count_of(a) > count_of(b); });
  std::array<bool, kBins> keep{};
  for (std::size_t i = 0; i < 3; ++i)
    keep[static_cast<std::size_t>(order[i])] = 10 * count_of(order[i]) >= count_of(order[0]);
  std::erase_if(candidates, [&](const Candidate& c) {
    return !keep[static_cast<std::size_t>(bin_of(c.turned))];
  });
}

std::unordered_set<LandmarkId> shown_landmarks(const TrackedFrame& frame) {
  std::unordered_set<LandmarkId> shown;
  for (const FeatureMatch& m : frame.matches)
    if (m.shows_landmark()) shown.insert(m.landmark);
  return shown;
}

void drop_matched_features(const TrackedFrame& frame, std::vector<std::uint16_t>& features) {
  std::erase_if(features, [&](std::uint16_t f) { return frame.matches[f].matched; });
}

bool in_image(const PinholeCamera& camera, const Eigen::Vector2d& pixel) {
  return pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < camera.width && pixel.y() < camera.height;
}

// Depth measured in the frame must agree with where the landmark is: the same tolerance in
// disparity as in position.
void drop_wrong_disparity(const TrackedFrame& frame, double disparity, double radius,
                          std::vector<std::uint16_t>& features) {
  std::erase_if(features, [&](std::uint16_t f) {
    const Feature& feature = frame.features.points[f];
    return feature.has_depth() && std::abs(feature.disparity - disparity) > radius;
  });
}

}  // namespace

int match_to_last_frame(const TrackedFrame& last, const LocalMap& map, double radius,
                        TrackedFrame& frame) {
  const Rig& rig = *frame.rig;
  const Rigid3 camera_from_map = frame.map_from_camera.inverse();
  const auto shown = shown_landmarks(frame);

  std::vector<FeatureMatch> wanted(last.features.size());
  std::vector<Candidate> candidates;
  std::vector<std::uint16_t> nearby;
  for (std::size_t i = 0; i < last.features.size(); ++i) {
    FeatureMatch& want = wanted[i];
    const Feature& before = last.features.points[i];
    const LocalLandmark* landmark =
        last.matches[i].shows_landmark() ? map.find(last.matches[i].landmark) : nullptr;
    if (landmark) {
      if (shown.contains(landmark->id)) continue;
      want = {true, landmark->id, landmark->position};
    } else if (before.has_depth() && rig.camera.depth(before.disparity) < rig.max_depth) {
      want = {true, {}, last.point_in_map(i)};
    } else {
      continue;
    }
    const Eigen::Vector3d in_camera = camera_from_map * want.position;
    if (in_camera.z() <= 0) continue;
    const Eigen::Vector2d pixel = rig.camera.project(in_camera);
    if (!in_image(rig.camera, pixel)) continue;

    const double reach = radius * rig.pyramid.scale(before.octave);
    nearby.clear();
    frame.grid.search(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()),
                      static_cast<float>(reach), before.octave - 1, before.octave + 1, nearby);
    drop_matched_features(frame, nearby);
    drop_wrong_disparity(frame, rig.camera.disparity(in_camera.z()), reach, nearby);
    const Nearest n = nearest_feature(last.features.descriptors[i], frame, nearby);
    if (n.best > kMaxDistance) continue;
    candidates.push_back(
        {i, n.feature, n.best, frame.features.points[n.feature].angle - before.angle});
  }
  keep_consistently_turned(candidates);
  int added = 0;
  for (const Candidate& c : best_per_feature(candidates, frame.features.size())) {
    frame.matches[c.feature] = wanted[c.point];
    ++added;
  }
  return added;
}

int match_to_landmarks(std::span<const LocalLandmark* const> landmarks, double radius,
                       TrackedFrame& frame) {
  const Rig& rig = *frame.rig;
  const Rigid3 camera_from_map = frame.map_from_camera.inverse();
  const Eigen::Matrix3d rotation = camera_from_map.rotation.toRotationMatrix();
  const double log_factor = std::log(static_cast<double>(rig.pyramid.factor));
  const auto shown = shown_landmarks(frame);

  std::vector<Candidate> candidates;
  std::vector<std::uint16_t> nearby;
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const LocalLandmark& landmark = *landmarks[i];
    const Eigen::Vector3d in_camera = rotation * landmark.position + camera_from_map.translation;
    if (in_camera.z() <= 0) continue;
    const Eigen::Vector2d pixel = rig.camera.project(in_camera);
    if (!in_image(rig.camera, pixel)) continue;
    const Eigen::Vector3d to_camera = frame.map_from_camera.origin() - landmark.position;
    const double distance = to_camera.norm();
    // A fifth more on both sides: the octave that a feature is found at varies by one.
    if (distance < 0.8 * landmark.min_distance || distance > 1.2 * landmark.max_distance) continue;
    const double cosine = to_camera.dot(landmark.normal) / distance;
    if (cosine < kMinViewCosine) continue;
    if (shown.contains(landmark.id)) continue;

    const int octave = std::clamp(
        static_cast<int>(std::ceil(std::log(landmark.max_distance / distance) / log_factor)), 0,
        rig.pyramid.levels - 1);
    // What is seen almost as it was before is found where it should be.
    const double reach = radius * (cosine > 0.998 ? 2.5 : 4.0) * rig.pyramid.scale(octave);
    nearby.clear();
    frame.grid.search(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()),
                      static_cast<float>(reach), octave - 1, octave, nearby);
    drop_matched_features(frame, nearby);
    drop_wrong_disparity(frame, rig.camera.disparity(in_camera.z()), reach, nearby);
    const Nearest n = nearest_feature(landmark.descriptor, frame, nearby);
    if (n.best > kMaxDistance) continue;
    if (n.best_octave == n.second_octave && n.best > kLocalRatio * n.second) continue;
    candidates.push_back({i, n.feature, n.best, 0});
  }
  int added = 0;
  for (const Candidate& c : best_per_feature(candidates, frame.features.size())) {
    const LocalLandmark& landmark = *landmarks[c.point];
    frame.matches[c.feature] = {true, landmark.id, landmark.position};
    ++added;
  }
  return added;
}

int match_to_keyframe(const Keyframe& keyframe, const LocalMap& map, TrackedFrame& frame) {
  const std::vector<LandmarkId> shown_by_keyframe = map.landmarks_by_feature(keyframe);
  const auto shown = shown_landmarks(frame);
  std::vector<std::uint16_t> free_features;
  for (std::size_t f = 0; f < frame.features.size(); ++f)
    if (!frame.matches[f].matched) free_features.push_back(static_cast<std::uint16_t>(f));

  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < shown_by_keyframe.size(); ++i) {
    if (!shown_by_keyframe[i].is_valid() || shown.contains(shown_by_keyframe[i])) continue;
    const Nearest n = nearest_feature(keyframe.features.descriptors[i], frame, free_features);
    if (n.best > kMaxDistanceByLooks || n.best > kLooksRatio * n.second) continue;
    candidates.push_back(
        {i, n.feature, n.best,
         frame.features.points[n.feature].angle - keyframe.features.points[i].angle});
  }
  keep_consistently_turned(candidates);
  int added = 0;
  for (const Candidate& c : best_per_feature(candidates, frame.features.size())) {
    const LocalLandmark* landmark = map.find(shown_by_keyframe[c.point]);
    frame.matches[c.feature] = {true, landmark->id, landmark->position};
    ++added;
  }
  return added;
}

}  // namespace cairn
