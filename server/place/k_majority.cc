#include "server/place/k_majority.h"

#include <algorithm>
#include <array>

#include "common/feature/hamming.h"

namespace cairn {
namespace {

// How many of a set of descriptors have each bit.
class BitCounts {
 public:
  void add(const Descriptor& descriptor) {
    ++size_;
    for (std::size_t bit = 0; bit < 256; ++bit)
      counts_[bit] += (descriptor[bit / 64] >> (bit % 64)) & 1;
  }
  std::size_t size() const { return size_; }
  Descriptor majority(const Descriptor& when_even) const {
    Descriptor result{};
    for (std::size_t bit = 0; bit < 256; ++bit) {
      const std::size_t twice = 2 * std::size_t{counts_[bit]};
      const std::uint64_t even = (when_even[bit / 64] >> (bit % 64)) & 1;
      const std::uint64_t value = twice == size_ ? even : twice > size_;
      result[bit / 64] |= value << (bit % 64);
    }
    return result;
  }

 private:
  std::array<std::uint32_t, 256> counts_{};
  std::size_t size_ = 0;
};

// A number in [0, bound), the same with every standard library.
std::uint64_t draw(std::mt19937_64& random, std::uint64_t bound) {
  return random() % bound;
}

// k-means++: each centre is drawn with a chance that grows with the squared distance to those
// before it. Fewer than k where every descriptor is a centre already.
std::vector<Descriptor> first_centres(std::span<const Descriptor> descriptors, std::size_t k,
                                      std::mt19937_64& random) {
  std::vector<Descriptor> centres{descriptors[draw(random, descriptors.size())]};
  std::vector<std::uint64_t> cost(descriptors.size(), 256 * 256);
  while (centres.size() < k) {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      const auto d = static_cast<std::uint64_t>(hamming_distance(descriptors[i], centres.back()));
      cost[i] = std::min(cost[i], d * d);
      sum += cost[i];
    }
    if (sum == 0) break;
    std::uint64_t at = draw(random, sum);
    std::size_t chosen = 0;
    while (at >= cost[chosen]) at -= cost[chosen++];
    centres.push_back(descriptors[chosen]);
  }
  return centres;
}

// True when any descriptor changed its cluster.
bool assign(std::span<const Descriptor> descriptors, Clusters& clusters) {
  bool changed = false;
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    int best_distance = 257;
    std::size_t best = 0;
    for (std::size_t c = 0; c < clusters.centres.size(); ++c) {
      const int distance = hamming_distance(descriptors[i], clusters.centres[c]);
      if (distance < best_distance) best_distance = distance, best = c;
    }
    changed |= clusters.cluster_of[i] != best;
    clusters.cluster_of[i] = static_cast<std::uint8_t>(best);
  }
  return changed;
}

// Centres become the majority of theirs; clusters that have lost all are dropped.
void move_centres(std::span<const Descriptor> descriptors, Clusters& clusters) {
  std::vector<BitCounts> counts(clusters.centres.size());
  for (std::size_t i = 0; i < descriptors.size(); ++i)
    counts[clusters.cluster_of[i]].add(descriptors[i]);
  std::vector<Descriptor> centres;
  std::vector<std::uint8_t> renamed(counts.size(), 0);
  for (std::size_t c = 0; c < counts.size(); ++c) {
    renamed[c] = static_cast<std::uint8_t>(centres.size());
    if (counts[c].size() > 0) centres.push_back(counts[c].majority(clusters.centres[c]));
  }
  for (std::uint8_t& cluster : clusters.cluster_of) cluster = renamed[cluster];
  clusters.centres = std::move(centres);
}

}  // namespace

Descriptor majority(std::span<const Descriptor> descriptors) {
  BitCounts counts;
  for (const Descriptor& descriptor : descriptors) counts.add(descriptor);
  return counts.majority(descriptors.front());
}

Clusters k_majority(std::span<const Descriptor> descriptors, std::size_t k, int iterations,
                    std::mt19937_64& random) {
  Clusters clusters;
  if (descriptors.empty() || k == 0) return clusters;
  clusters.centres = first_centres(descriptors, k, random);
  clusters.cluster_of.assign(descriptors.size(), 0);
  assign(descriptors, clusters);
  for (int i = 0; i < iterations; ++i) {
    move_centres(descriptors, clusters);
    if (!assign(descriptors, clusters)) break;
  }
  move_centres(descriptors, clusters);
  return clusters;
}

}  // namespace cairn
