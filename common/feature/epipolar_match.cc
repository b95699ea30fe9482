#include "common/feature/epipolar_match.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "common/feature/hamming.h"
#include "common/model/measurement_noise.h"

namespace cairn {
namespace {

constexpr double kChi2Line = 3.84;  // 95 % quantile with one degree of freedom
constexpr int kMaxOctaves = 4;      // apart

// Features of b, laid out so that a loop over all of them takes several at a time.
struct Targets {
  std::vector<float> x, y, max_squared;
  std::vector<std::uint16_t> index;
  std::vector<std::uint8_t> octave;
  std::vector<std::uint8_t> on_line;  // of the line that was asked for last

  Targets(const View& view, const std::vector<std::uint16_t>& features) : index(features) {
    for (const std::uint16_t i : features) {
      const Feature& f = view.feature(i);
      x.push_back(f.x);
      y.push_back(f.y);
      // Wider than the noise of a position (ScalePyramid::sigma): the poses that draw the line are
      // not adjusted yet.
      const double tolerance = view.rig->pyramid.scale(f.octave);
      max_squared.push_back(static_cast<float>(kChi2Line * tolerance * tolerance));
      octave.push_back(f.octave);
    }
    on_line.resize(index.size());
  }

  void find_on(const Eigen::Vector3f& line) {
    const float a = line.x(), b = line.y(), c = line.z();
    const float *xs = x.data(), *ys = y.data(), *most = max_squared.data();
    std::uint8_t* to = on_line.data();
    for (std::size_t i = 0, size = on_line.size(); i < size; ++i) {
      const float error = a * xs[i] + b * ys[i] + c;
      to[i] = error * error <= most[i];
    }
  }
};

struct Match {
  FeaturePair pair;
  int distance;
};

// The matrix that takes (x, y, 1) in pixels of a to the epipolar line in pixels of b, normals not
// normalised.
Eigen::Matrix3d fundamental_matrix(const View& a, const View& b) {
  const Rigid3 b_from_a = b.camera_from_map * a.camera_from_map.inverse();
  const Eigen::Matrix3d essential =
      skew(b_from_a.translation) * b_from_a.rotation.toRotationMatrix();
  const auto rays_from_pixels = [](const PinholeCamera& c) {
    Eigen::Matrix3d m;
    m << 1 / c.fx, 0, -c.cx / c.fx, 0, 1 / c.fy, -c.cy / c.fy, 0, 0, 1;
    return m;
  };
  return rays_from_pixels(b.rig->camera).transpose() * essential * rays_from_pixels(a.rig->camera);
}

// The two least distances to descriptors of features on the line; the index of the least.
struct Search {
  int best = 257, second = 257;
  std::uint16_t index = 0;
};

Search search_line(const Eigen::Vector3f& line, const Feature& feature,
                   const Descriptor& descriptor, Targets& targets,
                   const std::vector<Descriptor>& descriptors) {
  Search found;
  targets.find_on(line);
  for (std::size_t i = 0; i < targets.index.size(); ++i) {
    if (!targets.on_line[i]) continue;
    if (std::abs(int{targets.octave[i]} - int{feature.octave}) > kMaxOctaves) continue;
    const int distance = hamming_distance(descriptor, descriptors[targets.index[i]]);
    if (distance < found.best) {
      found = {distance, found.best, targets.index[i]};
    } else {
      found.second = std::min(found.second, distance);
    }
  }
  return found;
}

// Keeps the best match of each feature of b.
void keep_distinct(std::vector<Match>& matches) {
  std::sort(matches.begin(), matches.end(), [](const Match& x, const Match& y) {
    if (x.pair.second != y.pair.second) return x.pair.second < y.pair.second;
    if (x.distance != y.distance) return x.distance < y.distance;
    return x.pair.first < y.pair.first;
  });
  matches.erase(
      std::unique(matches.begin(), matches.end(),
                  [](const Match& x, const Match& y) { return x.pair.second == y.pair.second; }),
      matches.end());
}

// Right matches turn by the same angle, wrong ones by any. Keeps those near the commonest turn.
void keep_common_turn(const View& a, const View& b, std::vector<Match>& matches) {
  constexpr int kBins = 24;
  const auto bin = [&](const Match& m) {
    double turn = double{a.feature(m.pair.first).angle} - b.feature(m.pair.second).angle;
    turn /= 2 * std::numbers::pi;
    return std::min(kBins - 1, static_cast<int>((turn - std::floor(turn)) * kBins));
  };
  std::array<int, kBins> count{};
  for (const Match& m : matches) ++count[static_cast<std::size_t>(bin(m))];
  const auto around = [&](int i) {
    return count[static_cast<std::size_t>((i + kBins - 1) % kBins)] +
           count[static_cast<std::size_t>(i)] + count[static_cast<std::size_t>((i + 1) % kBins)];
  };
  int peak = 0;
  for (int i = 1; i < kBins; ++i)
    if (around(i) > around(peak)) peak = i;
  std::erase_if(matches, [&](const Match& m) {
    const int off = std::abs(bin(m) - peak);
    return std::min(off, kBins - off) > 1;
  });
}

// A feature's scale times its distance is the same in every view.
bool scales_agree(const View& a, const View& b, const FeaturePair& pair,
                  const Eigen::Vector3d& point, double tolerance) {
  const double reach_a =
      (a.camera_from_map * point).norm() * a.rig->pyramid.scale(a.feature(pair.first).octave);
  const double reach_b =
      (b.camera_from_map * point).norm() * b.rig->pyramid.scale(b.feature(pair.second).octave);
  return reach_a < tolerance * reach_b && reach_b < tolerance * reach_a;
}

bool reprojects(const View& view, const Feature& feature, const Eigen::Vector3d& point) {
  return reprojection_chi2(view, feature, point) <=
         (feature.has_depth() ? kChi2ThreeDof : kChi2TwoDof);
}

std::optional<Eigen::Vector3d> point_of(const View& a, const View& b, const FeaturePair& pair,
                                        const PairOptions& options) {
  const Feature &in_a = a.feature(pair.first), &in_b = b.feature(pair.second);
  const auto point = triangulate_two_views(a, in_a, b, in_b);
  if (!point || point->relative_sigma > options.max_relative_sigma) return std::nullopt;
  if (!reprojects(a, in_a, point->position) || !reprojects(b, in_b, point->position) ||
      !scales_agree(a, b, pair, point->position, options.scale_tolerance))
    return std::nullopt;
  return point->position;
}

}  // namespace

std::vector<FeaturePair> match_on_epipolar_lines(const View& a,
                                                 const std::vector<std::uint16_t>& free_a,
                                                 const View& b,
                                                 const std::vector<std::uint16_t>& free_b,
                                                 const PairOptions& options) {
  Targets targets(b, free_b);
  const Eigen::Matrix3d line_from_pixel = fundamental_matrix(a, b);
  std::vector<Match> matches;
  for (const std::uint16_t i : free_a) {
    const Feature& f = a.feature(i);
    Eigen::Vector3d line = line_from_pixel * Eigen::Vector3d(f.x, f.y, 1);
    const double length = line.head<2>().norm();
    if (!(length > 1e-12)) continue;  // both cameras stand in one place, or this is the epipole
    line /= length;
    const Search found = search_line(line.cast<float>(), f, a.features->descriptors[i], targets,
                                     b.features->descriptors);
    if (found.best <= options.max_distance && found.best < options.ratio * found.second)
      matches.push_back({{i, found.index}, found.best});
  }
  keep_distinct(matches);
  keep_common_turn(a, b, matches);

  std::vector<FeaturePair> pairs;
  for (const Match& m : matches) pairs.push_back(m.pair);
  return pairs;
}

std::vector<PairPoint> triangulate_pairs(const View& a, const std::vector<std::uint16_t>& free_a,
                                         const View& b, const std::vector<std::uint16_t>& free_b,
                                         const PairOptions& options) {
  std::vector<PairPoint> points;
  for (const FeaturePair& pair : match_on_epipolar_lines(a, free_a, b, free_b, options))
    if (const auto position = point_of(a, b, pair, options))
      points.push_back({pair.first, pair.second, *position});
  return points;
}

}  // namespace cairn
