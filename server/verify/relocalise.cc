#include "server/verify/relocalise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <unordered_map>
#include <unordered_set>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "common/feature/hamming.h"
#include "server/verify/side.h"
#include "server/verify/view_matches.h"
#include "server/verify/view_pose.h"

namespace cairn {
namespace {

constexpr double kConfidence = 0.999;
constexpr double kMinDepth = 0.05;  // metres; nearer is inside the lens
constexpr double kMinCosine = 0.5;  // of the angle between normal and line of sight
// Something nearer than this share of a landmark's depth, within so many pixels, hides it.
constexpr double kHides = 0.85;
constexpr float kHideRadius = 20;
// Points nearer to a plane than this share of their distance are taken for flat.
constexpr double kFlat = 0.03;
// Landmarks farther from each other than this share of their distance from the camera are not the
// same thing; so many features are asked for what looks like them.
constexpr double kElsewhere = 0.1;
constexpr std::size_t kRivalFeatures = 120;
constexpr int kColumns = 8, kRows = 6;
constexpr int kCellExpects = 3;                 // landmarks that make a cell's silence telling
constexpr std::size_t kWitnesses = 7;           // keyframes that say what should show
constexpr std::array kGrowthFactors{2.0, 1.0};  // on the radius, one a round

struct Found {
  int feature = -1;
  int distance = 257;
};

class Locator {
 public:
  Locator(const Map& map, const Keyframe& view, const FeatureGrid& grid,
          const LocateOptions& options)
      : map_(map), view_(view), grid_(grid), options_(options), camera_(view.rig->camera) {}

  Locating run(KeyframeId candidate) {
    if (!map_.keyframes.contains(candidate))
      result_.why = "the keyframe is not in the map";
    else
      result_.why = agree(candidate);
    if (result_.why.empty()) result_.why = grow();
    if (result_.why.empty()) result_.why = doubt();
    if (result_.why.empty()) result_.location = location();
    return std::move(result_);
  }

 private:
  // Steps 1 and 2.
  std::string agree(KeyframeId candidate) {
    const auto group = group_of(map_, candidate, options_.covisibles, options_.min_shared);
    matches_ = match_view(view_, landmarks_seen_by(map_, group),
                          map_.keyframes.at(candidate).map_from_camera.translation, options_);
    result_.matches = static_cast<int>(matches_.size());
    if (result_.matches >= options_.min_consensus) consent();
    result_.consensus = static_cast<int>(matches_.size());
    if (result_.matches < options_.min_consensus || result_.consensus < options_.min_consensus)
      return fmt::format("{} of {} matches agree, fewer than {}",
                         result_.matches < options_.min_consensus ? 0 : result_.consensus,
                         result_.matches, options_.min_consensus);
    return {};
  }

  // Leaves the matches that one pose explains; none where no pose is found.
  void consent() {
    std::vector<ViewMatch> kept;
    for (const int i : consensus_of(matches_, camera_from_map_))
      kept.push_back(matches_[static_cast<std::size_t>(i)]);
    matches_ = std::move(kept);
    if (!camera_from_map_.is_finite()) matches_.clear();
  }

  // The matches that most agree on one pose, by their numbers, and the pose.
  std::vector<int> consensus_of(const std::vector<ViewMatch>& matches,
                                Rigid3& camera_from_map) const {
    std::vector<cv::Point3d> points;
    std::vector<cv::Point2d> pixels;
    for (const ViewMatch& m : matches) {
      const Eigen::Vector3d& p = m.landmark->position;
      const Feature& f = view_.features.points[m.feature];
      points.emplace_back(p.x(), p.y(), p.z());
      pixels.emplace_back(f.x, f.y);
    }
    const cv::Matx33d k(camera_.fx, 0, camera_.cx, 0, camera_.fy, camera_.cy, 0, 0, 1);
    cv::Vec3d rotation, translation;
    std::vector<int> consensus;
    // OpenCV's generator is per thread and starts where it was left: the same seed for the same
    // answer.
    cv::theRNG().state = 0x9e3779b9;
    try {
      if (!cv::solvePnPRansac(points, pixels, k, cv::noArray(), rotation, translation, false,
                              options_.iterations, options_.pixels, kConfidence, consensus,
                              cv::SOLVEPNP_AP3P))
        consensus.clear();
    } catch (const cv::Exception&) {
      consensus.clear();  // degenerate samples, such as points on a line
    }
    camera_from_map = Rigid3(so3_exp({rotation[0], rotation[1], rotation[2]}),
                             {translation[0], translation[1], translation[2]});
    return consensus;
  }

  // Step 3.
  std::string grow() {
    for (const double factor : kGrowthFactors) {
      if (!refine()) return "the matches that agree make no pose";
      rank_keyframes();
      find_around(factor * options_.radius);
    }
    (void)refine();
    result_.inliers = static_cast<int>(matches_.size());
    rank_keyframes();
    if (result_.inliers < options_.min_inliers)
      return fmt::format("{} inliers, fewer than {}", result_.inliers, options_.min_inliers);
    return {};
  }

  // Leaves the matches that agree with the refined pose.
  bool refine() {
    std::vector<PointSight> sights;
    for (const ViewMatch& m : matches_) sights.push_back({m.landmark->position, m.feature});
    const auto good = refine_view_pose(view_, sights, options_.slack, camera_from_map_);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i)
      if (good[i]) matches_[kept++] = matches_[i];
    matches_.resize(kept);
    return kept >= 4;
  }

  // By how many of the matched landmarks they see.
  void rank_keyframes() {
    std::map<KeyframeId, int> votes;
    for (const ViewMatch& m : matches_)
      for (const Observation& o : m.landmark->observations) ++votes[o.keyframe];
    std::vector<std::pair<int, KeyframeId>> order;
    for (const auto& [id, count] : votes) order.emplace_back(-count, id);
    std::sort(order.begin(), order.end());
    around_.clear();
    for (std::size_t i = 0; i < std::min(options_.around, order.size()); ++i)
      around_.push_back(order[i].second);
  }

  // A feature wanted by several landmarks goes to the one that looks most like it.
  void find_around(double radius) {
    std::unordered_map<std::uint16_t, std::pair<int, const Landmark*>> best;
    for (const SeenLandmark& seen : landmarks_seen_by(map_, around_)) {
      if (!project(*seen.landmark)) continue;
      const Found found = find(*seen.landmark, radius);
      if (found.feature < 0) continue;
      const auto f = static_cast<std::uint16_t>(found.feature);
      auto& entry = best.try_emplace(f, 257, nullptr).first->second;
      if (found.distance < entry.first) entry = {found.distance, seen.landmark};
    }
    matches_.clear();
    for (const auto& [feature, entry] : best) matches_.push_back({entry.second, feature});
    std::sort(matches_.begin(), matches_.end(),
              [](const ViewMatch& a, const ViewMatch& b) { return a.feature < b.feature; });
  }

  // False where the landmark can't be seen. Sets pixel_, depth_ and octave_.
  bool project(const Landmark& l) {
    const Eigen::Vector3d p = camera_from_map_ * l.position;
    if (!(p.z() > kMinDepth)) return false;
    pixel_ = camera_.project(p);
    depth_ = p.z();
    if (pixel_.x() < 0 || pixel_.y() < 0 || pixel_.x() >= camera_.width ||
        pixel_.y() >= camera_.height)
      return false;
    const double distance = p.norm();
    if (distance < 0.8 * l.min_distance || distance > 1.2 * l.max_distance) return false;
    if (-(camera_from_map_.rotation * l.normal).dot(p) < kMinCosine * distance) return false;
    const ScalePyramid& pyramid = view_.rig->pyramid;
    const double octave =
        std::ceil(std::log(l.max_distance / distance) / std::log(double{pyramid.factor}));
    octave_ = std::clamp(static_cast<int>(octave), 0, pyramid.levels - 1);
    return true;
  }

  // The feature that looks most like it near its projection, if it looks and lies as it should.
  Found find(const Landmark& l, double radius) {
    near_.clear();
    grid_.search(static_cast<float>(pixel_.x()), static_cast<float>(pixel_.y()),
                 static_cast<float>(radius * view_.rig->pyramid.scale(octave_)), octave_ - 1,
                 octave_ + 1, near_);
    Found best{-1, options_.grow_distance + 1};
    for (const std::uint16_t f : near_) {
      const int distance = hamming_distance(l.descriptor, view_.features.descriptors[f]);
      if (distance < best.distance) best = {f, distance};
    }
    return best;
  }

  // Whether a feature near the projection is so near to the camera that it stands before it.
  bool is_hidden() {
    near_.clear();
    grid_.search(static_cast<float>(pixel_.x()), static_cast<float>(pixel_.y()), kHideRadius, 0,
                 view_.rig->pyramid.levels - 1, near_);
    return std::any_of(near_.begin(), near_.end(), [&](std::uint16_t f) {
      const Feature& feature = view_.features.points[f];
      return feature.has_depth() && camera_.baseline > 0 &&
             camera_.depth(feature.disparity) < kHides * depth_;
    });
  }

  int cell_of(double x, double y) const {
    const int column = std::clamp(static_cast<int>(kColumns * x / camera_.width), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(kRows * y / camera_.height), 0, kRows - 1);
    return row * kColumns + column;
  }

  // Step 4.
  std::string doubt() {
    std::unordered_set<int> cells;
    for (const ViewMatch& m : matches_) {
      const Feature& f = view_.features.points[m.feature];
      cells.insert(cell_of(f.x, f.y));
    }
    result_.cells = static_cast<int>(cells.size());
    if (result_.cells < options_.min_cells)
      return fmt::format("in {} parts of the image, fewer than {}", result_.cells,
                         options_.min_cells);
    const double distinctive = static_cast<double>(result_.consensus) / result_.inliers;
    if (distinctive < options_.min_distinctive)
      return fmt::format("{:.2f} of the inliers are distinctive, less than {}", distinctive,
                         options_.min_distinctive);
    look_for_what_should_show();
    if (result_.found < options_.min_found)
      return fmt::format("{:.2f} of what should show does, less than {}", result_.found,
                         options_.min_found);
    if (result_.contradicted > options_.max_contradicted)
      return fmt::format("nothing of what should show does in {:.2f} of the image, more than {}",
                         result_.contradicted, options_.max_contradicted);
    if (const std::string why = doubt_extent(); !why.empty()) return why;
    result_.rival = rival_share();
    if (result_.rival > options_.max_rival)
      return fmt::format("another pose explains {:.2f} of as much, more than {}", result_.rival,
                         options_.max_rival);
    return {};
  }

  // Is it flat, and no larger than a poster?
  std::string doubt_extent() const {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const ViewMatch& m : matches_) mean += m.landmark->position;
    mean /= static_cast<double>(matches_.size());
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    bool depth = false;
    for (const ViewMatch& m : matches_) {
      const Eigen::Vector3d d = m.landmark->position - mean;
      covariance += d * d.transpose() / static_cast<double>(matches_.size());
      depth = depth || view_.features.points[m.feature].has_depth();
    }
    const Eigen::Vector3d variances =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues();  // ascending
    const double distance = (camera_from_map_ * mean).norm();
    if (std::sqrt(std::max(0.0, variances(0))) > kFlat * distance) return {};
    // Of points spread evenly over a length L the standard deviation is L / sqrt(12).
    const double extent = std::sqrt(12 * variances(2));
    const double needed = depth ? options_.min_flat_extent_m : options_.min_flat_extent * distance;
    if (extent >= needed) return {};
    return fmt::format(
        "all that shows is flat and {:.2f} long, less than {:.2f}: could be a poster", extent,
        needed);
  }

  // What the best other pose explains of the same features, by landmarks around that look like the
  // matched ones and lie elsewhere. Some of the features stand for all.
  double rival_share() const {
    const std::vector<SeenLandmark> around = landmarks_seen_by(map_, around_);
    const std::size_t step = 1 + matches_.size() / kRivalFeatures;
    const Eigen::Vector3d camera = camera_from_map_.inverse().translation;
    std::vector<ViewMatch> others;
    int asked = 0;
    for (std::size_t i = 0; i < matches_.size(); i += step) {
      ++asked;
      const ViewMatch& own = matches_[i];
      const Eigen::Vector3d& place = own.landmark->position;
      const double elsewhere = kElsewhere * (place - camera).norm();
      int nearest = options_.max_distance + 1;
      const Landmark* other = nullptr;
      for (const SeenLandmark& seen : around) {
        const int distance =
            hamming_distance(seen.landmark->descriptor, view_.features.descriptors[own.feature]);
        if (distance >= nearest || (seen.landmark->position - place).norm() < elsewhere) continue;
        nearest = distance;
        other = seen.landmark;
      }
      if (other) others.push_back({other, own.feature});
    }
    if (static_cast<double>(others.size()) <= options_.max_rival * asked || others.size() < 4)
      return 0;
    Rigid3 unused;
    return static_cast<double>(consensus_of(others, unused).size()) / asked;
  }

  // Landmarks that one keyframe alone has seen say little by not being seen.
  void look_for_what_should_show() {
    std::array<int, kColumns * kRows> expected{}, found{};
    const std::vector<KeyframeId> witnesses(
        around_.begin(),
        around_.begin() + static_cast<std::ptrdiff_t>(std::min(kWitnesses, around_.size())));
    for (const SeenLandmark& seen : landmarks_seen_by(map_, witnesses)) {
      if (seen.landmark->observations.size() < 2 || !project(*seen.landmark)) continue;
      const auto cell = static_cast<std::size_t>(cell_of(pixel_.x(), pixel_.y()));
      const Found feature = find(*seen.landmark, options_.radius);
      if (feature.feature < 0 && is_hidden()) continue;
      ++expected[cell];
      found[cell] += feature.feature >= 0;
    }
    int all = 0, shown = 0, silent = 0, confirmed = 0;
    for (std::size_t cell = 0; cell < expected.size(); ++cell) {
      all += expected[cell];
      shown += found[cell];
      confirmed += found[cell] > 0;
      silent += found[cell] == 0 && expected[cell] >= kCellExpects;
    }
    result_.found = all > 0 ? static_cast<double>(shown) / all : 1.0;
    result_.contradicted =
        silent + confirmed > 0 ? static_cast<double>(silent) / (silent + confirmed) : 0.0;
  }

  Location location() const {
    Location l;
    l.map_from_camera = camera_from_map_.inverse();
    l.around = around_;
    std::unordered_set<LandmarkId> known;
    for (const ViewMatch& m : matches_)
      if (known.insert(m.landmark->id).second) l.matches.push_back({m.feature, m.landmark->id});
    return l;
  }

  const Map& map_;
  const Keyframe& view_;
  const FeatureGrid& grid_;
  const LocateOptions& options_;
  const PinholeCamera& camera_;
  Rigid3 camera_from_map_;
  std::vector<ViewMatch> matches_;  // ascending by feature from growth on
  std::vector<KeyframeId> around_;  // see Location
  Locating result_;

  // Of the landmark projected last.
  Eigen::Vector2d pixel_ = Eigen::Vector2d::Zero();
  double depth_ = 0;
  int octave_ = 0;
  std::vector<std::uint16_t> near_;
};

}  // namespace

Locating locate(const Map& map, const Keyframe& view, const FeatureGrid& grid, KeyframeId candidate,
                const LocateOptions& options) {
  return Locator(map, view, grid, options).run(candidate);
}

}  // namespace cairn
