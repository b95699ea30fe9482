#include "server/mapping/local_adjuster.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/util/clock.h"
#include "server/mapping/step.h"

namespace cairn {
namespace {

// Keyframes that are free besides those that a solve is for, at the least.
constexpr std::size_t kLeastBesides = 2;

// That a keyframe is held by in a window that is no longer full size; a quarter of it does still.
constexpr std::size_t kLandmarksEach = 400;

// By how much more than `from` wait, down to a quarter.
LocalWindowOptions thinned(LocalWindowOptions window, std::size_t backlog, std::size_t from) {
  constexpr double kLeast = 0.25;
  if (backlog <= from) return window;
  const double share = std::max(kLeast, static_cast<double>(from) / static_cast<double>(backlog));
  const auto thin = [&](std::size_t count) {
    return static_cast<std::size_t>(std::ceil(share * static_cast<double>(count)));
  };
  window.max_free = thin(window.max_free);
  window.max_fixed = thin(window.max_fixed);
  window.landmarks_each = thin(kLandmarksEach);
  return window;
}

}  // namespace

LocalAdjuster::LocalAdjuster(MapWriter& writer, LocalSolver solver,
                             const LocalAdjusterOptions& options)
    : writer_(writer), solver_(std::move(solver)), options_(options) {}

void LocalAdjuster::add(KeyframeId id) {
  std::lock_guard lock(mutex_);
  waiting_.push_back(id);
}

std::size_t LocalAdjuster::waiting() const {
  std::lock_guard lock(mutex_);
  return waiting_.size();
}

bool LocalAdjuster::is_free(const std::vector<KeyframeId>& keyframes) const {
  return std::none_of(keyframes.begin(), keyframes.end(),
                      [&](KeyframeId id) { return busy_.contains(id); });
}

// The centre, the first that waits but for those of the runs in `without`, and what else waits and
// sees the same. A run's keyframes are taken in order or not at all.
std::vector<KeyframeId> LocalAdjuster::companions(const Map& map, KeyframeId centre,
                                                  std::set<std::uint64_t> without) const {
  const std::size_t most = std::min(options_.max_together, options_.window.max_free);
  std::set<KeyframeId> near{centre};
  if (const KeyframeNode* node = map.keyframes.find(centre))
    for (const Covisible& c : node->covisible)
      if (c.shared >= options_.window.min_shared) near.insert(c.keyframe);
  std::vector<KeyframeId> all;
  for (const KeyframeId id : waiting_) {
    if (all.size() >= std::max<std::size_t>(most, 1)) break;
    if (without.contains(id.epoch)) continue;
    if (near.contains(id))
      all.push_back(id);
    else
      without.insert(id.epoch);
  }
  return all;
}

LocalAdjuster::Claim LocalAdjuster::claim(std::size_t more_coming) {
  std::lock_guard lock(mutex_);
  if (waiting_.empty() || (more_coming > 0 && waiting_.size() < options_.max_together)) return {};
  Claim claim;
  claim.window = thinned(options_.window, more_coming + waiting_.size() - 1, options_.thin_from);
  const Snapshot map = writer_.snapshot();
  const std::size_t max_free = claim.window.max_free;
  std::set<std::uint64_t> passed_over = runs_;  // a run's keyframes are served in order
  for (const KeyframeId id : waiting_) {
    if (passed_over.contains(id.epoch)) continue;
    claim.centres = companions(*map, id, passed_over);
    // However small the window, all that it is for are free in it, and some of what they see.
    claim.window.max_free = std::max(
        max_free, std::min(options_.window.max_free, claim.centres.size() + kLeastBesides));
    const auto free = choose_free_keyframes(*map, claim.centres, claim.window);
    if (is_free(free) && is_free(claim.centres)) {
      claim.region.insert(free.begin(), free.end());
      break;
    }
    claim.centres.clear();
    passed_over.insert(id.epoch);
  }
  claim.region.insert(claim.centres.begin(), claim.centres.end());
  for (const KeyframeId id : claim.centres) runs_.insert(id.epoch);
  busy_.insert(claim.region.begin(), claim.region.end());
  std::erase_if(waiting_, [&](KeyframeId id) {
    return std::find(claim.centres.begin(), claim.centres.end(), id) != claim.centres.end();
  });
  return claim;
}

void LocalAdjuster::release(const Claim& claim) {
  std::lock_guard lock(mutex_);
  for (const KeyframeId id : claim.region) busy_.erase(id);
  for (const KeyframeId id : claim.centres) runs_.erase(id.epoch);
}

LocalAdjustment LocalAdjuster::adjust(std::size_t more_coming, std::stop_token stop) {
  const Claim claim = this->claim(more_coming);
  LocalAdjustment report;
  if (claim.centres.empty()) return report;
  Stopwatch watch;
  take_step(writer_, [&](const Map& map) {
    const LocalWindow window = choose_local_window(map, claim.centres, claim.window);
    report.window_ms += lap(watch);
    report.solved = solver_ && !window.free_keyframes.empty();
    MapDelta delta = report.solved ? solver_(map, window, stop) : MapDelta::based_on(map);
    // With the result, so that a saved map never has the one without the other.
    delta.mapped_keyframes = claim.centres;
    return delta;
  });
  report.solve_ms = lap(watch);
  report.keyframes_culled = take_step(writer_, [&](const Map& map) {
                              return cull_keyframes(map, claim.centres, options_.cull);
                            }).keyframes_removed;
  report.cull_ms = lap(watch);
  release(claim);
  report.keyframes = claim.centres;
  return report;
}

}  // namespace cairn
