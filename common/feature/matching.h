// Matching of features by descriptor: what tracking and mapping have in common.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/model/features.h"

namespace cairn {

// Distances below which two features may show the same thing: `strict` where nothing else speaks
// for it, `loose` where the position was predicted.
inline constexpr int kStrictDistance = 50;
inline constexpr int kLooseDistance = 100;

// The two nearest of some candidates.
struct Nearest {
  int index = -1;      // as in the list of candidates; -1: there were none
  int distance = 257;  // of the nearest
  int runner_up = -1;  // second nearest
  int runner_up_distance = 257;

  // The nearest is near enough and clearly nearer than the second: distance <= max_distance and
  // distance <= ratio * runner_up_distance.
  bool accept(int max_distance, float ratio) const {
    return index >= 0 && distance <= max_distance &&
           static_cast<float>(distance) <= ratio * static_cast<float>(runner_up_distance);
  }
};

// `candidates` index `descriptors`, as FeatureGrid::search finds them. Of equals the first is
// taken.
Nearest nearest(const Descriptor& wanted, std::span<const std::uint16_t> candidates,
                std::span<const Descriptor> descriptors);
// Among all of `descriptors`.
Nearest nearest(const Descriptor& wanted, std::span<const Descriptor> descriptors);

// Shorthand: the nearest candidate's index, or -1 where it is not accepted.
int best_match(const Descriptor& wanted, std::span<const std::uint16_t> candidates,
               std::span<const Descriptor> descriptors, int max_distance, float ratio = 1.0f);

// Feature a of one image and b of another.
struct FeatureMatch {
  std::uint16_t a = 0, b = 0;
  std::uint16_t distance = 0;

  bool operator==(const FeatureMatch&) const = default;
};

// Pairs that are each other's nearest, within max_distance, and clearly so seen from `a` (ratio).
// Compares all with all. Ascending in a.
std::vector<FeatureMatch> match_mutual(std::span<const Descriptor> a, std::span<const Descriptor> b,
                                       int max_distance, float ratio = 1.0f);

// Between two images all features turn by about the same angle. Given the turn of each match
// (radians, any range), says which matches agree with the most frequent turns: the three fullest
// bins of 12 degrees, less those with under a tenth of the fullest.
std::vector<bool> consistent_turns(std::span<const float> turns);

// Keeps those of `matches` that agree (consistent_turns of b's angle less a's).
void keep_consistent_turns(const Features& a, const Features& b,
                           std::vector<FeatureMatch>& matches);

}  // namespace cairn
