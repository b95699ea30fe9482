#include "server/verify/consensus.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cairn {
namespace {

constexpr double kConfidence = 0.999;
// Sides of the two triangles may differ by this share and so many metres before they are tried.
constexpr double kSideTolerance = 0.15, kSideSlack = 0.05;

// splitmix64 (Steele et al. 2014): alike with every standard library.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : state_(seed) {}
  std::size_t below(std::size_t count) {
    state_ += 0x9e3779b97f4a7c15ULL;
    return detail::mix(state_) % count;
  }

 private:
  std::uint64_t state_;
};

struct PointPairs {
  std::vector<Eigen::Vector3d> query, candidate;
};

PointPairs pick(const PointPairs& all, std::span<const int> indices) {
  PointPairs picked;
  for (const int i : indices) {
    picked.query.push_back(all.query[static_cast<std::size_t>(i)]);
    picked.candidate.push_back(all.candidate[static_cast<std::size_t>(i)]);
  }
  return picked;
}

// With a fixed scale both triangles have sides of the same lengths.
bool congruent(const PointPairs& three) {
  for (std::size_t i = 0; i < 3; ++i) {
    const double q = (three.query[i] - three.query[(i + 1) % 3]).norm();
    const double c = (three.candidate[i] - three.candidate[(i + 1) % 3]).norm();
    if (std::abs(q - c) > kSideTolerance * std::max(q, c) + kSideSlack) return false;
  }
  return true;
}

int needed_iterations(std::size_t inliers, std::size_t all, int limit) {
  const double share = static_cast<double>(inliers) / static_cast<double>(all);
  const double miss = 1 - share * share * share;
  if (miss <= 0) return 0;
  const double needed = std::log(1 - kConfidence) / std::log(miss);
  return needed < limit ? static_cast<int>(std::ceil(needed)) : limit;
}

// Aligns to all inliers as long as that brings more of them.
void improve(const PointPairs& all, const std::vector<SharedPoint>& points, bool with_scale,
             Consensus& best) {
  for (int round = 0; round < 3; ++round) {
    const PointPairs in = pick(all, best.inliers);
    const auto aligned = align_points(in.query, in.candidate, with_scale);
    if (!aligned) return;
    std::vector<int> inliers = agreeing(points, *aligned);
    if (inliers.size() <= best.inliers.size()) return;
    best = {*aligned, std::move(inliers)};
  }
}

}  // namespace

std::vector<SharedPoint> shared_points(const Side& query, const Side& candidate,
                                       const std::vector<LandmarkPair>& matches, double slack) {
  std::vector<SharedPoint> points;
  points.reserve(matches.size());
  for (const auto& m : matches) {
    const SideLandmark& q = query.landmarks[static_cast<std::size_t>(m.query)];
    const SideLandmark& c = candidate.landmarks[static_cast<std::size_t>(m.candidate)];
    points.push_back({candidate.sight(c, q.position, slack), query.sight(q, c.position, slack)});
  }
  return points;
}

std::vector<int> agreeing(const std::vector<SharedPoint>& points,
                          const Sim3& candidate_from_query) {
  const Sim3 query_from_candidate = candidate_from_query.inverse();
  std::vector<int> found;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (agrees(points[i].in_a, candidate_from_query) &&
        agrees(points[i].in_b, query_from_candidate))
      found.push_back(static_cast<int>(i));
  return found;
}

Consensus find_consensus(const Side& query, const Side& candidate,
                         const std::vector<LandmarkPair>& matches,
                         const std::vector<SharedPoint>& points, const VerifyOptions& options) {
  PointPairs all;
  for (const auto& m : matches) {
    all.query.push_back(query.landmarks[static_cast<std::size_t>(m.query)].position);
    all.candidate.push_back(candidate.landmarks[static_cast<std::size_t>(m.candidate)].position);
  }
  Consensus best;
  if (matches.size() < 3) return best;
  Draw draw(options.seed);
  int needed = options.iterations;
  // Triangles that don't fit cost next to nothing and don't count much: ten times as many draws.
  for (int i = 0, drawn = 0; i < needed && drawn < 10 * needed; ++drawn) {
    const std::array<int, 3> sample{static_cast<int>(draw.below(matches.size())),
                                    static_cast<int>(draw.below(matches.size())),
                                    static_cast<int>(draw.below(matches.size()))};
    if (sample[0] == sample[1] || sample[1] == sample[2] || sample[0] == sample[2]) continue;
    const PointPairs three = pick(all, sample);
    if (options.fix_scale && !congruent(three)) continue;
    ++i;
    const auto aligned = align_points(three.query, three.candidate, !options.fix_scale);
    if (!aligned) continue;
    std::vector<int> inliers = agreeing(points, *aligned);
    if (inliers.size() <= best.inliers.size()) continue;
    best = {*aligned, std::move(inliers)};
    improve(all, points, !options.fix_scale, best);
    needed = needed_iterations(best.inliers.size(), matches.size(), options.iterations);
  }
  return best;
}

}  // namespace cairn
