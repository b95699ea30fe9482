#include "server/verify/view_matches.h"

#include <cmath>
#include <unordered_set>

#include "common/feature/matching.h"
#include "server/verify/similar_list.h"

namespace cairn {
namespace {

// So many of the most similar are looked at.
constexpr std::size_t kNearest = 3;
// Features nearer to each other than so many pixels, and landmarks nearer than this share of their
// distance from the keyframe, are taken for one thing that is there twice.
constexpr float kSamePixels = 6;
constexpr double kSamePlace = 0.03;

std::vector<Descriptor> descriptors_of(const std::vector<SeenLandmark>& seen) {
  std::vector<Descriptor> all;
  all.reserve(seen.size());
  for (const SeenLandmark& s : seen) all.push_back(s.landmark->descriptor);
  return all;
}

}  // namespace

std::vector<SeenLandmark> landmarks_seen_by(const Map& map,
                                            const std::vector<KeyframeId>& keyframes) {
  std::vector<SeenLandmark> all;
  std::unordered_set<LandmarkId> known;
  for (const KeyframeId id : keyframes) {
    const KeyframeNode& node = map.keyframes.at(id);
    for (std::size_t f = 0; f < node.landmarks.size(); ++f) {
      if (!node.landmarks[f].is_valid()) continue;
      const Landmark* landmark = map.landmarks.find(node.landmarks[f]);
      if (landmark && landmark->position.allFinite() && known.insert(landmark->id).second)
        all.push_back({landmark, node.features().points[f].angle});
    }
  }
  return all;
}

std::vector<ViewMatch> match_view(const Keyframe& view, const std::vector<SeenLandmark>& seen,
                                  const Eigen::Vector3d& from, const LocateOptions& options) {
  const auto& points = view.features.points;
  const auto same_pixel = [&](int a, int b) {
    const Feature &p = points[static_cast<std::size_t>(a)],
                  &q = points[static_cast<std::size_t>(b)];
    return std::abs(p.x - q.x) <= kSamePixels && std::abs(p.y - q.y) <= kSamePixels;
  };
  const auto same_place = [&](int a, int b) {
    const Eigen::Vector3d& p = seen[static_cast<std::size_t>(a)].landmark->position;
    const Eigen::Vector3d& q = seen[static_cast<std::size_t>(b)].landmark->position;
    return (p - q).norm() <= kSamePlace * (p - from).norm();
  };
  const auto similar =
      compare_all<kNearest>(descriptors_of(seen), view.features.descriptors,
                            distance_that_matters(options.max_distance, options.ratio));
  std::vector<ViewMatch> matches;
  std::vector<float> turns;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (!is_distinctive(similar.of_a[i], options.max_distance, options.ratio, same_pixel)) continue;
    const auto f = static_cast<std::size_t>(similar.of_a[i][0].index);
    if (similar.of_b[f][0].index != static_cast<int>(i)) continue;
    if (!is_distinctive(similar.of_b[f], options.max_distance, options.ratio, same_place)) continue;
    matches.push_back({seen[i].landmark, static_cast<std::uint16_t>(f)});
    turns.push_back(points[f].angle - seen[i].angle);
  }
  const std::vector<bool> alike = consistent_turns(turns);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < matches.size(); ++i)
    if (alike[i]) matches[kept++] = matches[i];
  matches.resize(kept);
  return matches;
}

}  // namespace cairn
