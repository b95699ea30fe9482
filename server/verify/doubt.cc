#include "server/verify/doubt.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <map>
#include <set>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

namespace cairn {
namespace {

const SideLandmark& of(const Side& side, int landmark) {
  return side.landmarks[static_cast<std::size_t>(landmark)];
}

constexpr int kColumns = 8, kRows = 6;

// In how many cells of a side's own first image the points of that side show.
int occupied_cells(const Side& side, const std::vector<int>& landmarks) {
  const PinholeCamera& camera = side.views.front().node->rig().camera;
  std::set<std::pair<int, int>> cells;
  for (const int l : landmarks) {
    const Eigen::Vector3d& p = of(side, l).position;
    if (!(p.z() > 0)) continue;
    const Eigen::Vector2d pixel = camera.project(p);
    if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() >= camera.width || pixel.y() >= camera.height)
      continue;
    cells.emplace(static_cast<int>(pixel.x() * kColumns / camera.width),
                  static_cast<int>(pixel.y() * kRows / camera.height));
  }
  return static_cast<int>(cells.size());
}

// --- Is it more than one object?

// Directions as seen from a side's first camera, in steps of about 9 degrees: parts of the scene.
using Part = std::pair<int, int>;
Part part_of(const Eigen::Vector3d& p) {
  constexpr double kStep = 0.16;  // radians
  return {static_cast<int>(std::floor(std::atan2(p.x(), p.z()) / kStep)),
          static_cast<int>(std::floor(std::atan2(p.y(), std::hypot(p.x(), p.z())) / kStep))};
}

struct Balance {
  int confirmed = 0, contradicted = 0;  // parts
  int expected = 0, found = 0;          // sights
};

// A part of the scene says no where none of its landmarks is found anywhere, though each should
// show in two images at least or in the only one there is; it says yes where a fourth of them are.
// From fewer than two landmarks nothing follows.
void weigh(const Side& side, const std::vector<Sought>& sought, std::size_t images,
           Balance& balance) {
  assert(sought.size() == side.landmarks.size());
  std::map<Part, Sought> parts;  // landmarks that should be found, and those that are
  for (std::size_t l = 0; l < sought.size(); ++l) {
    balance.expected += sought[l].expected;
    balance.found += sought[l].found;
    if (sought[l].expected < std::min<int>(2, static_cast<int>(images))) continue;
    Sought& part = parts[part_of(side.landmarks[l].position)];
    ++part.expected;
    part.found += sought[l].found > 0 ? 1 : 0;
  }
  for (const auto& [where, part] : parts) {
    if (part.expected < 2) continue;
    if (4 * part.found >= part.expected) ++balance.confirmed;
    if (20 * part.found < part.expected) ++balance.contradicted;
  }
}

std::string doubt_surroundings(const Side& query, const Side& candidate, const Evidence& evidence,
                               const VerifyOptions& options, Verification& v) {
  Balance balance;
  weigh(query, evidence.query, candidate.views.size(), balance);
  weigh(candidate, evidence.candidate, query.views.size(), balance);
  v.found = balance.expected ? static_cast<double>(balance.found) / balance.expected : 0;
  const int judged = balance.confirmed + balance.contradicted;
  v.contradicted = judged ? static_cast<double>(balance.contradicted) / judged : 1;
  if (v.contradicted > options.max_contradicted)
    return fmt::format("the surroundings differ: {} of {} parts of the scene contradict",
                       balance.contradicted, judged);
  if (v.found < options.min_found)
    return fmt::format("only {} of the {} landmarks that should show are found", balance.found,
                       balance.expected);
  return {};
}

// --- Is it flat, and no larger than a poster?

std::string doubt_extent(const Side& candidate, const std::vector<int>& landmarks,
                         const VerifyOptions& options, Verification& v) {
  // Points are taken for flat when their distance from a plane is less than what depth is
  // uncertain.
  constexpr double kFlat = 0.02;  // of the distance from the camera
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int l : landmarks) mean += of(candidate, l).position;
  mean /= static_cast<double>(landmarks.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const int l : landmarks) {
    const Eigen::Vector3d d = of(candidate, l).position - mean;
    covariance += d * d.transpose() / static_cast<double>(landmarks.size());
  }
  const Eigen::Vector3d variances =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues();  // ascending
  const double distance = mean.norm();
  if (std::sqrt(std::max(0.0, variances(0))) > kFlat * distance) return {};
  // Of points spread evenly over a length L the standard deviation is L / sqrt(12).
  const double extent = std::sqrt(12 * variances(2));
  v.flat_extent = extent;
  const double needed =
      options.fix_scale ? options.min_flat_extent_m : options.min_flat_extent * distance;
  if (extent >= needed) return {};
  return fmt::format("all in common is flat and {:.2f} long, less than {:.2f}: could be a poster",
                     extent, needed);
}

// --- Is it the only place that fits?

// Votes of similar pairs for translations, the rotation given: where the place is unique, no other
// has many.
class TranslationVotes {
 public:
  // `width`: of a cell, in metres of the candidate.
  explicit TranslationVotes(double width) : width_(width) {}

  void add(const Eigen::Vector3d& t, int landmark) { cells_[key(t)].insert(landmark); }

  // Landmarks of the query that vote for a translation within a cell of `t`.
  std::size_t around(const Eigen::Vector3d& t) const { return around(key(t)); }

  // The most votes for any translation further from `t`.
  std::size_t most_elsewhere(const Eigen::Vector3d& t) const {
    const Key own = key(t);
    std::size_t most = 0;
    for (const auto& [cell, voters] : cells_)
      if (distance(cell, own) > 3) most = std::max(most, around(cell));
    return most;
  }

 private:
  using Key = std::array<int, 3>;
  Key key(const Eigen::Vector3d& t) const {
    const Eigen::Vector3d k = (t / width_).array().round();
    return {static_cast<int>(k.x()), static_cast<int>(k.y()), static_cast<int>(k.z())};
  }
  static int distance(const Key& a, const Key& b) {
    return std::max({std::abs(a[0] - b[0]), std::abs(a[1] - b[1]), std::abs(a[2] - b[2])});
  }
  std::size_t around(const Key& k) const {
    std::set<int> voters;
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z)
          if (const auto cell = cells_.find({k[0] + x, k[1] + y, k[2] + z}); cell != cells_.end())
            voters.insert(cell->second.begin(), cell->second.end());
    return voters.size();
  }

  double width_;
  std::map<Key, std::set<int>> cells_;
};

std::string doubt_uniqueness(const Side& query, const Side& candidate, const Matches& matches,
                             const Sim3& candidate_from_query, const Grown& grown,
                             const VerifyOptions& options, Verification& v) {
  int distinctive = 0;
  for (const auto& pair : grown.pairs)
    distinctive += matches.distinctive[static_cast<std::size_t>(pair.query)] ? 1 : 0;
  v.distinctive = static_cast<double>(distinctive) / static_cast<double>(grown.pairs.size());
  if (v.distinctive < options.min_distinctive)
    return fmt::format("only {} of {} inliers are distinctive: the texture repeats", distinctive,
                       grown.pairs.size());

  constexpr double kCellShare = 0.02;  // width of a cell, of the distance from the camera
  double distance = 0;
  for (const auto& pair : grown.pairs) distance += of(candidate, pair.candidate).position.norm();
  TranslationVotes votes(kCellShare * distance / static_cast<double>(grown.pairs.size()));
  const Sim3 turn(candidate_from_query.rotation, Eigen::Vector3d::Zero(),
                  candidate_from_query.scale);
  for (const auto& pair : matches.similar)
    votes.add(of(candidate, pair.candidate).position - turn * of(query, pair.query).position,
              pair.query);
  const auto rival = static_cast<double>(votes.most_elsewhere(candidate_from_query.translation));
  const auto own = static_cast<double>(votes.around(candidate_from_query.translation));
  v.rival = rival / static_cast<double>(grown.pairs.size());
  v.rival_votes = rival > 0 ? rival / std::max(own, 1.0) : 0;
  if (v.rival > options.max_rival || v.rival_votes > options.max_rival_votes)
    return fmt::format("another place fits as well: {} landmarks against {}, of which {} alike",
                       rival, grown.pairs.size(), own);
  return {};
}

}  // namespace

std::string doubt(const Side& query, const Side& candidate, const Matches& matches,
                  const Sim3& candidate_from_query, const Grown& grown,
                  const VerifyOptions& options, Verification& v) {
  if (v.grown < options.min_inliers)
    return fmt::format("{} inliers, fewer than {}", v.grown, options.min_inliers);
  std::vector<int> of_query, of_candidate;
  for (const auto& pair : grown.pairs) {
    of_query.push_back(pair.query);
    of_candidate.push_back(pair.candidate);
  }
  v.cells_query = occupied_cells(query, of_query);
  v.cells_candidate = occupied_cells(candidate, of_candidate);
  if (std::min(v.cells_query, v.cells_candidate) < options.min_cells)
    return fmt::format("inliers lie in {} and {} parts of the images, fewer than {}", v.cells_query,
                       v.cells_candidate, options.min_cells);
  std::string why = doubt_surroundings(query, candidate, grown.evidence, options, v);
  if (why.empty()) why = doubt_extent(candidate, of_candidate, options, v);
  if (why.empty())
    why = doubt_uniqueness(query, candidate, matches, candidate_from_query, grown, options, v);
  return why;
}

}  // namespace cairn
