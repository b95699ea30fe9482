#include "client/tracking/mono_start.h"

#include <algorithm>
#include <cmath>

#include "client/tracking/motion_hypotheses.h"
#include "client/tracking/pose_solver.h"
#include "client/tracking/small_bundle.h"
#include "common/feature/two_view.h"
#include "common/model/measurement_noise.h"
#include "common/util/log.h"

namespace cairn {
namespace {

constexpr std::size_t kMaxSeen = 240;    // images kept; beyond, every second one is let go
constexpr std::size_t kMaxAdjusted = 8;  // images in the adjustment, the reference apart
constexpr int kSettleSteps = 6, kFirstSteps = 8, kLastSteps = 12;
constexpr double kLooseChi2 = 50;  // for motions that are not settled yet
constexpr int kTurnSteps = 8;
constexpr double kLeastBeyondTurn = 1;  // standard deviations
// Of two images alone: motions that explain them so much worse than the best one are out, and so
// are all but the best few.
constexpr double kMaxSettledScore = 2.5;
constexpr std::size_t kMaxSettled = 4;
// Of the depth of a point that becomes a landmark. Wide, as features lie within half a standard
// deviation here and the adjustment has more than two views.
constexpr double kMaxRelativeSigma = 0.4;
constexpr double kFar = 1000;  // in ways that the camera has gone: as good as infinitely far
constexpr double kSteadyCosine = 0.966;             // 15 degrees
constexpr double kSameTurn = 0.03, kSameWay = 0.3;  // radians

}  // namespace

// One followed image: a track's feature, its place, and how well that is known.
struct MonoStart::Seen {
  struct Sight {
    StartTrack track;
    Feature feature;
  };
  std::int64_t stamp_ns = 0;
  std::vector<Sight> sights;  // ascending by the reference's feature

  const Feature* find(std::uint16_t reference) const {
    const auto at = std::lower_bound(
        sights.begin(), sights.end(), reference,
        [](const Sight& s, std::uint16_t wanted) { return s.track.reference < wanted; });
    return at != sights.end() && at->track.reference == reference ? &at->feature : nullptr;
  }
};

// The try to explain the latest image.
class MonoStart::Attempt {
 public:
  Attempt(const Rig& rig, const MonoStartOptions& options, const Features& reference,
          const std::vector<Seen>& seen)
      : rig_(rig), options_(options), reference_(reference), seen_(seen), latest_(seen.back()) {}

  // One explanation: a motion and what follows from it.
  struct Solution {
    Rigid3 latest_from_reference;
    std::vector<std::size_t> points;  // indices into the latest image's sights
    SmallBundle bundle;               // points in the same order
    double cost = 0;                  // a sight's squared error, in variances
    double score =
        0;  // the same a track, those that are not explained at the bound: less is better
  };

  std::optional<Solution> explain() const {
    if (median_motion() < 0.5 * options_.min_parallax * rig_.camera.fx) return std::nullopt;
    std::vector<Solution> candidates = plausible();
    if (candidates.empty()) return std::nullopt;
    for (Solution& s : candidates) adjust(s);
    const Solution& chosen = *std::min_element(candidates.begin(), candidates.end(), is_better);
    const Eigen::Vector3d way = chosen.latest_from_reference.inverse().origin().normalized();
    log::debug(
        "mono start: {} images, {} tracks, {} points, parallax {:.2f} deg, cost {:.3f}, {:.2f} "
        "beyond "
        "a turn, {} explanations, t {:.2f} {:.2f} {:.2f}",
        seen_.size() + 1, latest_.sights.size(), chosen.points.size(),
        parallax(chosen) * 180 / M_PI, chosen.cost, median_beyond_turn(chosen), candidates.size(),
        way.x(), way.y(), way.z());
    if (!is_enough(chosen)) return std::nullopt;
    for (const Solution& other : candidates)
      if (is_rival(other, chosen)) return std::nullopt;
    return chosen;
  }

 private:
  static bool is_better(const Solution& a, const Solution& b) { return a.score < b.score; }

  void set_score(Solution& s, double total_cost) const {
    const auto tracks = static_cast<double>(latest_.sights.size());
    const auto points = static_cast<double>(s.points.size());
    s.cost = total_cost / std::max<double>(1, static_cast<double>(s.bundle.sights.size()));
    s.score = (points * s.cost + (tracks - points) * kChi2TwoDof) / tracks;
  }

  double median_motion() const {
    std::vector<double> motion;
    for (const auto& s : latest_.sights)
      motion.push_back((s.feature.pixel() - reference_.points[s.track.reference].pixel()).norm());
    std::nth_element(motion.begin(), motion.begin() + std::ssize(motion) / 2, motion.end());
    return motion[motion.size() / 2];
  }

  View reference_view() const { return {&rig_, &reference_, Rigid3()}; }
  View latest_view(const Rigid3& latest_from_reference) const {
    return {&rig_, nullptr, latest_from_reference};
  }

  // What may explain the image, the best first.
  std::vector<Solution> plausible() const {
    std::vector<PixelPair> pairs;
    for (const auto& s : latest_.sights)
      pairs.push_back({reference_.points[s.track.reference].pixel(), s.feature.pixel()});
    std::vector<Solution> solutions;
    add_settled(motion_hypotheses(rig_.camera, pairs), solutions);
    // A plane seen twice has two explanations, and what is nearly one has two that come near.
    if (!solutions.empty())
      add_settled(
          planar_motions(solutions.front().latest_from_reference, plane_of(solutions.front())),
          solutions);
    return solutions;
  }

  // Motions made to fit the two images as well as they can, each once; keeps the few best.
  void add_settled(const std::vector<Rigid3>& motions, std::vector<Solution>& solutions) const {
    for (const Rigid3& motion : motions) {
      Solution s{motion, {}, {}, 0, 0};
      if (!settle(s)) continue;
      const bool known =
          std::any_of(solutions.begin(), solutions.end(), [&](const Solution& other) {
            return is_same(s.latest_from_reference, other.latest_from_reference, 0.3);
          });
      if (!known) solutions.push_back(std::move(s));
    }
    std::stable_sort(solutions.begin(), solutions.end(), is_better);
    std::erase_if(solutions, [&](const Solution& s) {
      return s.score > kMaxSettledScore * solutions.front().score;
    });
    if (solutions.size() > kMaxSettled) solutions.resize(kMaxSettled);
  }

  // False when too little follows from the motion.
  bool settle(Solution& s) const {
    triangulate(s, kLooseChi2);
    if (static_cast<int>(s.points.size()) < options_.min_points) return false;
    s.bundle.camera_from_map = {Rigid3(), s.latest_from_reference};
    s.bundle.sights.clear();
    for (std::size_t p = 0; p < s.points.size(); ++p) {
      const Seen::Sight& sight = latest_.sights[s.points[p]];
      add_sight(s.bundle, 0, p, reference_.points[sight.track.reference]);
      add_sight(s.bundle, 1, p, sight.feature);
    }
    set_score(s, solve_small_bundle(rig_.camera, s.bundle, kSettleSteps));
    s.latest_from_reference = s.bundle.camera_from_map.back();
    s.latest_from_reference.translation.normalize();
    triangulate(s, kChi2TwoDof);
    return static_cast<int>(s.points.size()) >= options_.min_points;
  }

  // n with n * p = 1 for the points of the plane that most of them are about on.
  static Eigen::Vector3d plane_of(const Solution& s) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : s.bundle.points) {
      const Eigen::Vector3d ray = p / p.z();
      sum += ray * ray.transpose();
      right += ray / p.z();
    }
    return sum.ldlt().solve(right);
  }

  struct Explained {
    Eigen::Vector3d position;
    bool is_certain = false;  // how far it is
  };

  // The point that a track follows from; nothing when the motion contradicts it. What shows too
  // little parallax to tell how far it is contradicts nothing.
  std::optional<Explained> explain(const Seen::Sight& s, const Rigid3& motion,
                                   double max_chi2) const {
    const Feature& before = reference_.points[s.track.reference];
    const View a = reference_view(), b = latest_view(motion);
    const auto fits = [&](const Eigen::Vector3d& p) {
      return reprojection_chi2(a, before, p) <= max_chi2 &&
             reprojection_chi2(b, s.feature, p) <= max_chi2;
    };
    const auto point = triangulate_two_views(a, before, b, s.feature);
    if (point && fits(point->position))
      return Explained{point->position, point->relative_sigma <= kMaxRelativeSigma};
    const Eigen::Vector3d far = rig_.camera.unproject(before.pixel(), kFar);
    if (fits(far)) return Explained{far, false};
    return std::nullopt;
  }

  void triangulate(Solution& s, double max_chi2) const {
    s.points.clear();
    s.bundle.points.clear();
    for (std::size_t i = 0; i < latest_.sights.size(); ++i)
      if (const auto p = explain(latest_.sights[i], s.latest_from_reference, max_chi2)) {
        s.points.push_back(i);
        s.bundle.points.push_back(p->position);
      }
  }

  // The images in the adjustment: evenly spread, the latest one among them.
  std::vector<const Seen*> adjusted_images() const {
    const std::size_t count = std::min(kMaxAdjusted, seen_.size());
    std::vector<const Seen*> images;
    for (std::size_t i = 1; i <= count; ++i) images.push_back(&seen_[i * seen_.size() / count - 1]);
    return images;
  }

  void add_sight(SmallBundle& bundle, std::size_t view, std::size_t point, const Feature& f) const {
    bundle.sights.push_back({static_cast<std::uint32_t>(view), static_cast<std::uint32_t>(point),
                             f.pixel(), rig_.pyramid.scale(f.octave)});
  }

  // Views: the reference, then the images. Each image's pose is first solved for on its own.
  void adjust(Solution& s) const {
    const std::vector<const Seen*> images = adjusted_images();
    s.bundle.camera_from_map.assign(1, Rigid3());
    for (const Seen* image : images)
      s.bundle.camera_from_map.push_back(image == &latest_ ? s.latest_from_reference
                                                           : pose_of(*image, s));
    s.bundle.sights.clear();
    for (std::size_t p = 0; p < s.points.size(); ++p) {
      const std::uint16_t reference = latest_.sights[s.points[p]].track.reference;
      add_sight(s.bundle, 0, p, reference_.points[reference]);
      for (std::size_t v = 0; v < images.size(); ++v)
        if (const Feature* f = images[v]->find(reference)) add_sight(s.bundle, v + 1, p, *f);
    }
    solve_small_bundle(rig_.camera, s.bundle, kFirstSteps);
    drop_outliers(s);
    set_score(s, solve_small_bundle(rig_.camera, s.bundle, kLastSteps));
    s.latest_from_reference = s.bundle.camera_from_map.back();
    drop_outliers(s);
  }

  // Of one of the images in between, from the points.
  Rigid3 pose_of(const Seen& image, const Solution& s) const {
    return solve_image(image, s).map_from_camera.inverse();
  }

 public:
  PoseSolution solve_image(const Seen& image, const Solution& s) const {
    std::vector<PoseObservation> observations;
    for (std::size_t p = 0; p < s.points.size(); ++p)
      if (const Feature* f = image.find(latest_.sights[s.points[p]].track.reference))
        observations.push_back({s.bundle.points[p], f->pixel(), 0, measurement_sigma(rig_, *f)});
    return solve_pose(rig_.camera, Rigid3(), observations);
  }

 private:
  // Points that the reference or the latest image contradicts go; of the images in between, only
  // the sights.
  void drop_outliers(Solution& s) const {
    const std::size_t last = s.bundle.camera_from_map.size() - 1;
    std::vector<bool> good(s.points.size(), true);
    std::erase_if(s.bundle.sights, [&](const SmallBundle::Sight& sight) {
      const bool wrong = sight_chi2(rig_.camera, s.bundle, sight) > kChi2TwoDof;
      if (wrong && (sight.view == 0 || sight.view == last)) good[sight.point] = false;
      return wrong;
    });
    keep(s, good);
  }

  static void keep(Solution& s, const std::vector<bool>& good) {
    std::vector<std::uint32_t> place(good.size());
    std::size_t kept = 0;
    for (std::size_t p = 0; p < good.size(); ++p) {
      if (!good[p]) continue;
      place[p] = static_cast<std::uint32_t>(kept);
      s.points[kept] = s.points[p];
      s.bundle.points[kept++] = s.bundle.points[p];
    }
    s.points.resize(kept);
    s.bundle.points.resize(kept);
    std::erase_if(s.bundle.sights, [&](const auto& sight) { return !good[sight.point]; });
    for (auto& sight : s.bundle.sights) sight.point = place[sight.point];
  }

  bool is_enough(const Solution& s) const {
    if (static_cast<int>(s.points.size()) < options_.min_points ||
        static_cast<double>(s.points.size()) <
            options_.min_share * static_cast<double>(latest_.sights.size()))
      return false;
    return parallax(s) >= options_.min_parallax && !could_be_turn(s);
  }

  bool could_be_turn(const Solution& s) const {
    const double beyond_turn = median_beyond_turn(s);
    return beyond_turn < kLeastBeyondTurn ||
           beyond_turn < options_.min_beyond_turn * std::sqrt(s.cost);
  }

  // How far pixels are, in the median and in standard deviations, from where a camera that only
  // turned would see them: the least that a turn can reach.
  double median_beyond_turn(const Solution& s) const {
    Eigen::Quaterniond turn = s.latest_from_reference.rotation;
    std::vector<double> errors;
    for (int i = 0; i < kTurnSteps; ++i) {
      Eigen::Matrix3d information = 1e-9 * Eigen::Matrix3d::Identity();
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      errors.clear();
      for (const auto& sight : latest_.sights) {
        const Eigen::Vector3d ray =
            turn * rig_.camera.unproject(reference_.points[sight.track.reference].pixel(), 1);
        if (!(ray.z() > 0.1)) continue;
        const double sigma = rig_.pyramid.scale(sight.feature.octave);
        const Eigen::Vector2d error = (rig_.camera.project(ray) - sight.feature.pixel()) / sigma;
        const double length = error.norm();
        errors.push_back(length);
        const double weight = length < 1 ? 1 : 1 / length;  // of least distances, not squares
        const Eigen::Matrix<double, 2, 3> by_turn =
            -rig_.camera.projection_jacobian(ray).topRows<2>() * skew(ray) / sigma;
        information += weight * by_turn.transpose() * by_turn;
        gradient += weight * by_turn.transpose() * error;
      }
      turn = (so3_exp(-information.ldlt().solve(gradient)) * turn).normalized();
    }
    if (errors.empty()) return 0;
    const auto middle = errors.begin() + std::ssize(errors) / 2;
    std::nth_element(errors.begin(), middle, errors.end());
    return *middle;
  }

  // That so many points exceed as the options ask for.
  double parallax(const Solution& s) const {
    const Eigen::Vector3d latest = s.latest_from_reference.inverse().origin();
    std::vector<double> angles;
    for (const Eigen::Vector3d& p : s.bundle.points) {
      const Eigen::Vector3d a = -p, b = latest - p;
      angles.push_back(std::atan2(a.cross(b).norm(), a.dot(b)));
    }
    const std::size_t wanted =
        std::min(static_cast<std::size_t>(options_.parallax_points), angles.size() / 2);
    const auto at = angles.begin() + static_cast<std::ptrdiff_t>(wanted);
    std::nth_element(angles.begin(), at, angles.end(), std::greater<>());
    return *at;
  }

  // Explains about as much and is another motion.
  bool is_rival(const Solution& other, const Solution& chosen) const {
    return other.score < options_.min_rival_score * chosen.score &&
           !is_same(other.latest_from_reference, chosen.latest_from_reference, 1);
  }

  // Whether two motions differ by less than `tolerance` times what makes them different.
  static bool is_same(const Rigid3& a, const Rigid3& b, double tolerance) {
    const double cosine = a.translation.normalized().dot(b.translation.normalized());
    return a.rotation.angularDistance(b.rotation) < tolerance * kSameTurn &&
           std::acos(std::clamp(cosine, -1.0, 1.0)) < tolerance * kSameWay;
  }

 public:
  // In the map's unit, with what is certain enough to track by.
  StartMap start_map(const Solution& s, std::int64_t reference_stamp_ns) const {
    std::vector<std::size_t> certain;
    for (std::size_t p = 0; p < s.points.size(); ++p) {
      const auto point = explain(latest_.sights[s.points[p]], s.latest_from_reference, kChi2TwoDof);
      if (point && point->is_certain) certain.push_back(p);
    }
    StartMap map{reference_stamp_ns, reference_, {}, {}};
    if (certain.empty()) return map;
    std::vector<double> depths;
    for (const std::size_t p : certain) depths.push_back(s.bundle.points[p].z());
    std::nth_element(depths.begin(), depths.begin() + std::ssize(depths) / 2, depths.end());
    const double scale = options_.median_depth / depths[depths.size() / 2];

    for (const Seen& image : seen_) {
      Rigid3 pose = &image == &latest_ ? s.latest_from_reference.inverse()
                                       : solve_image(image, s).map_from_camera;
      pose.translation *= scale;
      map.poses.push_back({image.stamp_ns, pose});
    }
    for (const std::size_t p : certain) {
      const Seen::Sight& sight = latest_.sights[s.points[p]];
      map.points.push_back(
          {sight.track.reference, sight.track.feature, scale * s.bundle.points[p]});
    }
    return map;
  }

 private:
  const Rig& rig_;
  const MonoStartOptions& options_;
  const Features& reference_;
  const std::vector<Seen>& seen_;
  const Seen& latest_;
};

MonoStart::MonoStart(std::shared_ptr<const Rig> rig, const MonoStartOptions& options)
    : rig_(std::move(rig)), options_(options) {}
MonoStart::~MonoStart() = default;
MonoStart::MonoStart(MonoStart&&) noexcept = default;
MonoStart& MonoStart::operator=(MonoStart&&) noexcept = default;

void MonoStart::begin(std::int64_t stamp_ns, const Features& features) {
  tracks_.reset();
  seen_.clear();
  if (static_cast<int>(features.size()) < options_.min_features) return;
  reference_stamp_ns_ = stamp_ns;
  tracks_.emplace(features);
  ways_.clear();
}

// A camera that stands still for minutes must not fill the memory.
void MonoStart::thin_out() {
  if (seen_.size() <= kMaxSeen) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < seen_.size(); i += 2) seen_[kept++] = std::move(seen_[i]);
  seen_.resize(kept);
}

// A wrong explanation is another one with every image.
bool MonoStart::is_steady(const Eigen::Vector3d& way) {
  std::erase_if(ways_, [&](const Eigen::Vector3d& w) { return w.dot(way) < kSteadyCosine; });
  ways_.push_back(way);
  return std::ssize(ways_) >= options_.steady_images;
}

std::optional<StartMap> MonoStart::add(std::int64_t stamp_ns, const Features& features,
                                       const FeatureGrid& grid) {
  if (!tracks_) {
    begin(stamp_ns, features);
    return std::nullopt;
  }
  const std::vector<StartTrack> tracks = tracks_->follow(features, grid);
  if (static_cast<int>(tracks.size()) < options_.min_tracks) {
    begin(stamp_ns, features);
    return std::nullopt;
  }
  thin_out();
  Seen& latest = seen_.emplace_back(Seen{stamp_ns, {}});
  for (const StartTrack& t : tracks) latest.sights.push_back({t, features.points[t.feature]});

  const Attempt attempt(*rig_, options_, tracks_->reference(), seen_);
  const auto solution = attempt.explain();
  if (!solution) {
    ways_.clear();
    return std::nullopt;
  }
  if (!is_steady(solution->latest_from_reference.inverse().origin().normalized()))
    return std::nullopt;
  StartMap map = attempt.start_map(*solution, reference_stamp_ns_);
  if (static_cast<int>(map.points.size()) < options_.min_points) return std::nullopt;
  return map;
}

}  // namespace cairn
