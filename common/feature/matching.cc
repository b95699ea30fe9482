#include "common/feature/matching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

void offer(Nearest& n, int index, int distance) {
  if (distance < n.distance) {
    n.runner_up = n.index;
    n.runner_up_distance = n.distance;
    n.index = index;
    n.distance = distance;
  } else if (distance < n.runner_up_distance) {
    n.runner_up = index;
    n.runner_up_distance = distance;
  }
}

constexpr int kTurnBins = 30;
constexpr int kTurnPeaks = 3;

int turn_bin(float turn) {
  const float share = turn / static_cast<float>(2 * M_PI);
  const int bin = static_cast<int>((share - std::floor(share)) * kTurnBins + 0.5f);
  return bin % kTurnBins;
}

}  // namespace

Nearest nearest(const Descriptor& wanted, std::span<const std::uint16_t> candidates,
                std::span<const Descriptor> descriptors) {
  Nearest result;
  for (const std::uint16_t c : candidates)
    offer(result, c, hamming_distance(wanted, descriptors[c]));
  return result;
}

Nearest nearest(const Descriptor& wanted, std::span<const Descriptor> descriptors) {
  Nearest result;
  for (std::size_t i = 0; i < descriptors.size(); ++i)
    offer(result, static_cast<int>(i), hamming_distance(wanted, descriptors[i]));
  return result;
}

int best_match(const Descriptor& wanted, std::span<const std::uint16_t> candidates,
               std::span<const Descriptor> descriptors, int max_distance, float ratio) {
  const Nearest n = nearest(wanted, candidates, descriptors);
  return n.accept(max_distance, ratio) ? n.index : -1;
}

std::vector<FeatureMatch> match_mutual(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                       int max_distance, float ratio) {
  // Each distance is computed once: from_a of the row, from_b of every column at the same time.
  std::vector<Nearest> from_a(a.size()), from_b(b.size());
  for (std::size_t i = 0; i < a.size(); ++i)
    for (std::size_t j = 0; j < b.size(); ++j) {
      const int distance = hamming_distance(a[i], b[j]);
      offer(from_a[i], static_cast<int>(j), distance);
      offer(from_b[j], static_cast<int>(i), distance);
    }
  std::vector<FeatureMatch> matches;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Nearest& n = from_a[i];
    if (!n.accept(max_distance, ratio)) continue;
    if (from_b[static_cast<std::size_t>(n.index)].index != static_cast<int>(i)) continue;
    matches.push_back({static_cast<std::uint16_t>(i), static_cast<std::uint16_t>(n.index),
                       static_cast<std::uint16_t>(n.distance)});
  }
  return matches;
}

std::vector<bool> consistent_turns(std::span<const float> turns) {
  std::array<int, kTurnBins> counts{};
  for (const float turn : turns) ++counts[static_cast<std::size_t>(turn_bin(turn))];
  std::array<int, kTurnBins> bins;
  std::iota(bins.begin(), bins.end(), 0);
  const auto count = [&](int bin) { return counts[static_cast<std::size_t>(bin)]; };
  std::stable_sort(bins.begin(), bins.end(), [&](int i, int j) { return count(i) > count(j); });

  std::array<bool, kTurnBins> good{};
  for (int i = 0; i < kTurnPeaks; ++i) {
    const int bin = bins[static_cast<std::size_t>(i)];
    good[static_cast<std::size_t>(bin)] = 10 * count(bin) >= count(bins[0]);
  }
  std::vector<bool> result;
  result.reserve(turns.size());
  for (const float turn : turns) result.push_back(good[static_cast<std::size_t>(turn_bin(turn))]);
  return result;
}

void keep_consistent_turns(const Features& a, const Features& b,
                           std::vector<FeatureMatch>& matches) {
  std::vector<float> turns;
  turns.reserve(matches.size());
  for (const FeatureMatch& m : matches) turns.push_back(b.points[m.b].angle - a.points[m.a].angle);
  const std::vector<bool> good = consistent_turns(turns);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < matches.size(); ++i)
    if (good[i]) matches[kept++] = matches[i];
  matches.resize(kept);
}

}  // namespace cairn
