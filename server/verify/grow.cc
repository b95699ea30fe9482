#include "server/verify/grow.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

constexpr double kMinDepth = 0.05;  // metres; nearer is inside the lens
constexpr double kMinCosine = 0.5;  // of the angle between normal and line of sight
// Something nearer than this share of a landmark's depth, within so many pixels, hides it.
constexpr double kHides = 0.85;
constexpr float kHideRadius = 20;

// How often two landmarks were found to be one.
using Votes = std::map<std::pair<int, int>, int>;  // query's, candidate's

// Searches the landmarks of one side in the images of the other.
class Search {
 public:
  Search(const Side& from, const Side& into, const Sim3& into_from_from,
         const VerifyOptions& options)
      : from_(from), into_(into), transform_(into_from_from), options_(options) {}

  // `found(landmark of from, landmark of into)` for each that is found at a feature which shows a
  // landmark.
  template <typename Found>
  std::vector<Sought> run(Found&& found) {
    std::vector<Sought> all(from_.landmarks.size());
    for (const SideView& view : into_.views) {
      view_ = &view;
      camera_ = &view.node->rig().camera;
      camera_from_other_ = Sim3(view.camera_from_primary) * transform_;
      for (std::size_t l = 0; l < from_.landmarks.size(); ++l) {
        if (!project(from_.landmarks[l])) continue;
        const auto feature = find(from_.landmarks[l]);
        if (!feature && is_hidden()) continue;
        ++all[l].expected;
        if (!feature) continue;
        ++all[l].found;
        const auto own = into_.index.find(view.node->landmarks[*feature]);
        if (own != into_.index.end()) found(static_cast<int>(l), own->second);
      }
    }
    return all;
  }

 private:
  // False where the landmark can't be seen. Sets pixel_, depth_ and octave_.
  bool project(const SideLandmark& l) {
    const Eigen::Vector3d p = camera_from_other_ * l.position;
    if (!(p.z() > kMinDepth)) return false;
    pixel_ = camera_->project(p);
    if (pixel_.x() < 0 || pixel_.y() < 0 || pixel_.x() >= camera_->width ||
        pixel_.y() >= camera_->height)
      return false;
    depth_ = p.z();
    const double distance = p.norm() / camera_from_other_.scale;  // in the landmark's own unit
    if (distance < 0.8 * l.landmark->min_distance || distance > 1.2 * l.landmark->max_distance)
      return false;
    if (-(camera_from_other_.rotation * l.normal).dot(p) < kMinCosine * p.norm()) return false;
    const ScalePyramid& pyramid = view_->node->rig().pyramid;
    const double octave =
        std::ceil(std::log(l.landmark->max_distance / distance) / std::log(double{pyramid.factor}));
    octave_ = std::clamp(static_cast<int>(octave), 0, pyramid.levels - 1);
    return true;
  }

  // The feature that looks most like it near its projection, if it looks and lies as it should.
  std::optional<std::uint16_t> find(const SideLandmark& l) {
    const Features& features = view_->node->features();
    const double radius = options_.radius * view_->node->rig().pyramid.scale(octave_);
    near_.clear();
    view_->grid.search(static_cast<float>(pixel_.x()), static_cast<float>(pixel_.y()),
                       static_cast<float>(radius), octave_ - 1, octave_ + 1, near_);
    std::optional<std::uint16_t> best;
    int best_distance = options_.grow_distance + 1;
    for (const std::uint16_t f : near_) {
      const int distance = hamming_distance(l.landmark->descriptor, features.descriptors[f]);
      if (distance >= best_distance) continue;
      best_distance = distance;
      best = f;
    }
    if (!best) return best;
    const Sight sight(l.position, *view_->node->keyframe, features.points[*best],
                      view_->camera_from_primary, options_.slack);
    if (!agrees(sight, transform_)) best.reset();
    return best;
  }

  // Whether a feature near the projection is so near to the camera that it stands before the
  // landmark.
  bool is_hidden() {
    near_.clear();
    view_->grid.search(static_cast<float>(pixel_.x()), static_cast<float>(pixel_.y()), kHideRadius,
                       0, view_->node->rig().pyramid.levels - 1, near_);
    return std::any_of(near_.begin(), near_.end(), [&](std::uint16_t f) {
      const Feature& feature = view_->node->features().points[f];
      return feature.has_depth() && camera_->depth(feature.disparity) < kHides * depth_;
    });
  }

  const Side& from_;
  const Side& into_;
  const Sim3 transform_;
  const VerifyOptions& options_;
  const SideView* view_ = nullptr;
  const PinholeCamera* camera_ = nullptr;
  Sim3 camera_from_other_;
  Eigen::Vector2d pixel_ = Eigen::Vector2d::Zero();
  double depth_ = 0;
  int octave_ = 0;
  std::vector<std::uint16_t> near_;
};

// Each landmark goes with the one that it was found to be most often, if that holds the other way
// round too.
std::vector<LandmarkPair> elect(const Votes& votes) {
  std::map<int, std::pair<int, int>> of_query, of_candidate;  // landmark -> votes, other
  const auto offer = [](auto& best, int landmark, int count, int other) {
    auto& entry = best.try_emplace(landmark, 0, -1).first->second;
    if (count > entry.first) entry = {count, other};
  };
  for (const auto& [pair, count] : votes) {
    offer(of_query, pair.first, count, pair.second);
    offer(of_candidate, pair.second, count, pair.first);
  }
  std::vector<LandmarkPair> elected;
  for (const auto& [query, best] : of_query)
    if (of_candidate.at(best.second).second == query) elected.push_back({query, best.second});
  return elected;
}

}  // namespace

Grown grow(const Side& query, const Side& candidate, const Sim3& candidate_from_query,
           const VerifyOptions& options) {
  Grown grown;
  Votes votes;
  grown.evidence.query =
      Search(query, candidate, candidate_from_query, options).run([&](int q, int c) {
        ++votes[{q, c}];
      });
  grown.evidence.candidate =
      Search(candidate, query, candidate_from_query.inverse(), options).run([&](int c, int q) {
        ++votes[{q, c}];
      });
  const std::vector<LandmarkPair> elected = elect(votes);
  const std::vector<SharedPoint> points = shared_points(query, candidate, elected, options.slack);
  for (const int i : agreeing(points, candidate_from_query)) {
    grown.pairs.push_back(elected[static_cast<std::size_t>(i)]);
    grown.points.push_back(points[static_cast<std::size_t>(i)]);
  }
  return grown;
}

}  // namespace cairn
