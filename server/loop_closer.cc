#include "server/loop_closer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "common/util/clock.h"
#include "common/util/log.h"
#include "common/util/thread.h"
#include "server/map/connected.h"

namespace cairn {
namespace {

// Mapping goes first: a loop that is found a little later costs nobody anything
// (yield_to_others()).
constexpr int kGivesWay = 5;

// Of a merge, the part stays that has the keyframe which came first.
std::uint64_t first_arrival(const Map& map, const std::vector<KeyframeId>& part) {
  std::uint64_t first = UINT64_MAX;
  for (const KeyframeId id : part) first = std::min(first, map.keyframes.at(id).arrival);
  return first;
}

// Where a keyframe lies in the map according to the loop, that of the other side being right.
Sim3 map_from_query(const Map& map, const VerifiedLoop& loop) {
  return Sim3(map.keyframes.at(loop.candidate).map_from_camera) * loop.candidate_from_query;
}

void add_fusions(const VerifiedLoop& loop, MapDelta& delta) {
  for (const auto& [of_query, of_candidate] : loop.same)
    delta.fusions.push_back({of_query, of_candidate});
}

LoopEdge edge_of(const Map& map, const VerifiedLoop& loop) {
  LoopEdge edge;
  edge.query = loop.query;
  edge.candidate = loop.candidate;
  edge.candidate_from_query = in_units(loop.candidate_from_query, map.keyframes.at(loop.query).unit,
                                       map.keyframes.at(loop.candidate).unit);
  edge.inliers = loop.inliers;
  return edge;
}

// What an edge says in the map's unit as it is now.
RelativePose present(const Map& map, const LoopEdge& edge) {
  return {edge.query, edge.candidate,
          in_units(edge.candidate_from_query, 1 / map.keyframes.at(edge.query).unit,
                   1 / map.keyframes.at(edge.candidate).unit)};
}

// Which runs go on in the part that moves, and which have keyframes in others too (a client that
// was lost). `part` is sorted.
void tell_runs(const Map& map, const std::vector<KeyframeId>& part, LoopEdge& edge) {
  struct Run {
    KeyframeId latest;
    bool inside = false, outside = false;
  };
  std::map<std::uint64_t, Run> runs;
  map.keyframes.for_each([&](KeyframeId id, const KeyframeNode&) {
    Run& run = runs[id.epoch];
    run.latest = std::max(run.latest, id);
    const bool inside = std::binary_search(part.begin(), part.end(), id);
    (inside ? run.inside : run.outside) = true;
  });
  for (const auto& [epoch, run] : runs) {
    if (std::binary_search(part.begin(), part.end(), run.latest)) edge.moved.push_back(epoch);
    if (run.inside && run.outside) edge.split.push_back(epoch);
  }
}

}  // namespace

LoopCloser::LoopCloser(MapWriter& writer, std::shared_ptr<const Vocabulary> vocabulary,
                       const LoopCloserOptions& options, LoopCloserHooks hooks)
    : writer_(writer),
      vocabulary_(std::move(vocabulary)),
      options_(options),
      hooks_(std::move(hooks)),
      adjuster_(writer, {.ba = options.global_ba},
                [this](const auto& tickets) { on_adjusted(tickets); }) {
  for (const KeyframeId id : writer_.snapshot()->keyframes.sorted_keys())
    tasks_.push_back({Task::Kind::kIndex, id});
  thread_ = std::jthread([this] {
    name_this_thread("loop closer");
    yield_to_others(kGivesWay);
    run();
  });
}

LoopCloser::~LoopCloser() {
  close();
}

void LoopCloser::push(Task task) {
  {
    std::lock_guard lock(mutex_);
    if (closed_) return;
    tasks_.push_back(task);
  }
  changed_.notify_all();
}

void LoopCloser::offer(KeyframeId id) {
  push({Task::Kind::kRecognise, id});
  std::unique_lock lock(mutex_);
  const bool was_settled = settled_.erase(id.epoch) > 0;
  lock.unlock();
  if (was_settled) finish(id.epoch);
}

void LoopCloser::finish(std::uint64_t epoch) {
  push({Task::Kind::kFinish, {epoch, 0}});
}

bool LoopCloser::settled(std::uint64_t epoch) const {
  std::lock_guard lock(mutex_);
  return settled_.contains(epoch);
}

void LoopCloser::forget(std::uint64_t epoch) {
  push({Task::Kind::kForget, {epoch, 0}});
}

void LoopCloser::wait_idle() {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || (tasks_.empty() && !busy_); });
  }
  adjuster_.wait_idle();
}

void LoopCloser::close() {
  {
    std::lock_guard lock(mutex_);
    closed_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  adjuster_.stop();
}

void LoopCloser::run() {
  while (true) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return closed_ || !tasks_.empty(); });
    if (tasks_.empty()) return;
    const Task task = tasks_.front();
    tasks_.pop_front();
    busy_ = true;
    const std::size_t waiting = tasks_.size();
    lock.unlock();
    carry_out(task, waiting);
    lock.lock();
    busy_ = false;
    lock.unlock();
    changed_.notify_all();
  }
}

void LoopCloser::carry_out(const Task& task, std::size_t waiting) {
  switch (task.kind) {
    case Task::Kind::kRecognise:
    case Task::Kind::kIndex: {
      const Snapshot map = writer_.snapshot();
      if (!map->keyframes.contains(task.keyframe)) return;  // culled before its turn
      index(*map, task.keyframe);
      if (task.kind == Task::Kind::kRecognise && waiting <= options_.max_waiting)
        recognise(*map, task.keyframe,
                  waiting + (hooks_.mapping_waits ? hooks_.mapping_waits() : 0));
      return;
    }
    case Task::Kind::kFinish:
      return settle(task.keyframe.epoch);
    case Task::Kind::kForget: {
      candidates_.erase(task.keyframe.epoch);
      std::lock_guard lock(mutex_);
      settled_.erase(task.keyframe.epoch);
      std::erase_if(finishing_, [&](const auto& f) { return f.second == task.keyframe.epoch; });
    }
  }
}

// All its keyframes have been looked up. A map with loops is adjusted as a whole once more. One
// without them is as good as local adjustment makes it: a global one was 4 % better on TUM fr1/rpy
// and 3 % worse on 7-Scenes kitchen, whose calibration is a rough one.
void LoopCloser::settle(std::uint64_t epoch) {
  const Snapshot map = writer_.snapshot();
  KeyframeId any;
  if (!map->loops.empty())
    map->keyframes.for_each([&](KeyframeId id, const KeyframeNode&) {
      if (id.epoch == epoch && any < id) any = id;
    });
  {
    // Under the lock, so that the answer finds the ticket.
    std::lock_guard lock(mutex_);
    if (any.is_valid() && !closed_)
      finishing_[adjuster_.request(any, false)] = epoch;
    else
      settled_.insert(epoch);
  }
  if (settled(epoch)) hooks_.changed();
}

void LoopCloser::on_adjusted(const std::vector<GlobalAdjuster::Ticket>& tickets) {
  {
    std::lock_guard lock(mutex_);
    for (const GlobalAdjuster::Ticket ticket : tickets)
      if (const auto run = finishing_.extract(ticket)) settled_.insert(run.mapped());
  }
  hooks_.changed();
}

void LoopCloser::index(const Map& map, KeyframeId id) {
  index_.add(id, vocabulary_->words(map.keyframes.at(id).features().descriptors));
  indexed_.insert(id);
  drop_culled(map);
}

void LoopCloser::recognise(const Map& map, KeyframeId id, std::size_t waiting) {
  ++counters_.recognised;
  const KeyframeId root = root_of(map, id);
  const std::size_t most_in_own_part =
      options_.most_in_own_part - std::min(options_.most_in_own_part, waiting);
  std::size_t in_own_part = 0;
  auto& finder = candidates_.try_emplace(id.epoch, options_.candidates).first->second;
  for (const LoopCandidate& candidate : finder.find(map, index_, id)) {
    if (root_of(map, candidate.keyframe) == root && in_own_part++ >= most_in_own_part) continue;
    ++counters_.candidates;
    VerifyOptions options = options_.verify;
    // Of two parts that are measured in metres, and within one, the scale is known.
    options.fix_scale = is_metric(map, id) && is_metric(map, candidate.keyframe);
    const Verification v = verify_loop(map, id, candidate.keyframe, options);
    log::debug("keyframe {} of run {:x} may show what {} of {:x} does (score {:.3f}): {}",
               id.sequence, id.epoch, candidate.keyframe.sequence, candidate.keyframe.epoch,
               candidate.score, v.loop ? "verified" : v.why);
    if (!v.loop) continue;
    ++counters_.verified;
    if (close_loop(*v.loop)) return;
  }
}

// Now and then: what is looked through must be bounded by the place and not by the time in it.
void LoopCloser::drop_culled(const Map& map) {
  if (indexed_.size() < map.keyframes.size() + map.keyframes.size() / 8 + 50) return;
  std::erase_if(indexed_, [&](KeyframeId id) {
    return !map.keyframes.contains(id) && (index_.remove(id), true);
  });
}

// The map may have moved on since the loop was verified: what it says of two cameras still holds.
bool LoopCloser::close_loop(const VerifiedLoop& loop) {
  constexpr int kAttempts = 3;
  for (int i = 0; i < kAttempts; ++i) {
    const Snapshot map = writer_.snapshot();
    if (!map->keyframes.contains(loop.query) || !map->keyframes.contains(loop.candidate))
      return false;
    const std::vector<KeyframeId> of_query = connected_keyframes(*map, loop.query);
    const bool merges = !std::binary_search(of_query.begin(), of_query.end(), loop.candidate);
    if (!merges && is_small(*map, loop)) {
      connect(loop);
      return true;
    }
    std::optional<LoopClosure> closure =
        merges ? merge(*map, loop, of_query, connected_keyframes(*map, loop.candidate))
               : distribute(*map, loop, of_query);
    if (!closure) return false;
    const Applied applied = writer_.submit(std::move(*closure));
    if (!applied.done) return false;
    if (applied.delta.is_void) continue;
    ++(merges ? counters_.merges : counters_.loops);
    log::info("{} at keyframe {} of run {:x}, with {} of {:x}: {} landmarks in common, {} fused",
              merges ? "parts merged" : "loop closed", loop.query.sequence, loop.query.epoch,
              loop.candidate.sequence, loop.candidate.epoch, loop.inliers, applied.delta.fused);
    if (hooks_.keep)
      if (Status s = hooks_.keep(*map); !s) log::warn("it can't be undone: {}", s.message());
    hooks_.changed();
    weld(loop);
    adjuster_.request(loop.query, true);
    return true;
  }
  return false;
}

bool LoopCloser::is_small(const Map& map, const VerifiedLoop& loop) const {
  const Rigid3& query = map.keyframes.at(loop.query).map_from_camera;
  const Rigid3& candidate = map.keyframes.at(loop.candidate).map_from_camera;
  const Rigid3 error = map_from_query(map, loop).move_pose(Rigid3()).inverse() * query;
  std::vector<double> distances;
  for (const auto& pair : loop.same)
    if (const Landmark* landmark = map.landmarks.find(pair.of_candidate))
      distances.push_back((landmark->position - candidate.translation).norm());
  if (distances.empty()) return false;
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return error.translation.norm() < options_.small_shift_share * *middle &&
         rotation_angle(error) < options_.small_turn &&
         std::abs(std::log(loop.candidate_from_query.scale)) < options_.small_scale;
}

// A part moves so that the query lies where the loop says: one that has no scale of its own beside
// one that is measured in metres, else the younger one.
LoopClosure LoopCloser::merge(const Map& map, const VerifiedLoop& loop,
                              const std::vector<KeyframeId>& of_query,
                              const std::vector<KeyframeId>& of_candidate) const {
  const Sim3 move =
      map_from_query(map, loop) * Sim3(map.keyframes.at(loop.query).map_from_camera).inverse();
  const bool candidate_metric = is_metric(map, loop.candidate);
  const bool query_moves = candidate_metric != is_metric(map, loop.query)
                               ? candidate_metric
                               : first_arrival(map, of_candidate) < first_arrival(map, of_query);
  const std::vector<KeyframeId>& part = query_moves ? of_query : of_candidate;

  LoopClosure closure{.edge = edge_of(map, loop), .correction = MapDelta::based_on(map)};
  closure.edge.merges = true;
  closure.edge.new_map_from_old_map = query_moves ? move : move.inverse();
  for (const KeyframeId id : part) {
    const KeyframeNode& node = map.keyframes.at(id);
    closure.correction.poses.push_back(
        {id, node.map_from_camera,
         closure.edge.new_map_from_old_map.move_pose(node.map_from_camera),
         closure.edge.new_map_from_old_map.scale});
    for (const LandmarkId l : node.landmarks) {
      const Landmark* landmark = map.landmarks.find(l);
      if (landmark && landmark->reference == id)
        closure.correction.positions.push_back(
            {l, closure.edge.new_map_from_old_map * landmark->position});
    }
  }
  tell_runs(map, part, closure.edge);
  add_fusions(loop, closure.correction);
  return closure;
}

// Nothing when the loop contradicts the others of its part (sorted). Without a scale of its own a
// part may have drifted in scale, too, which is distributed like the rest.
std::optional<LoopClosure> LoopCloser::distribute(const Map& map, const VerifiedLoop& loop,
                                                  const std::vector<KeyframeId>& part) {
  std::vector<RelativePose> loops;
  for (const LoopEdge& edge : map.loops)
    if (edge.query != edge.candidate && std::binary_search(part.begin(), part.end(), edge.query))
      loops.push_back(present(map, edge));
  loops.push_back({loop.query, loop.candidate, loop.candidate_from_query});
  PoseGraphOptions options = options_.pose_graph;
  options.with_scale = !is_metric(map, loop.query);
  PoseGraphSummary summary;
  LoopClosure closure{.edge = edge_of(map, loop),
                      .correction = solve_pose_graph(map, loops, options, &summary)};
  log::debug("pose graph: {} keyframes, {} edges, {} loops, {} rejected, {:.0f} ms: {}",
             summary.keyframes, summary.edges, summary.loops, summary.rejected.size(),
             summary.solve_ms, summary.message);
  const bool rejected = std::find(summary.rejected.begin(), summary.rejected.end(),
                                  loops.size() - 1) != summary.rejected.end();
  if (!summary.usable || rejected || closure.correction.empty()) {
    ++counters_.contradicted;
    return std::nullopt;
  }
  add_fusions(loop, closure.correction);
  return closure;
}

// What lies within a little of where it should: no event, only what both sides see made one.
void LoopCloser::connect(const VerifiedLoop& loop) {
  MapDelta delta = MapDelta::based_on(*writer_.snapshot());
  add_fusions(loop, delta);
  if (writer_.submit(std::move(delta)).delta.is_void) return;
  ++counters_.connected;
  weld(loop);
}

// Both sides now lie where they should: finds the rest of what they have in common, then adjusts
// the seam.
void LoopCloser::weld(const VerifiedLoop& loop) {
  std::vector<KeyframeId> around{loop.query};
  const Snapshot welded = writer_.snapshot();
  if (const KeyframeNode* query = welded->keyframes.find(loop.query))
    for (std::size_t i = 0; i < std::min(options_.weld_neighbours, query->covisible.size()); ++i)
      around.push_back(query->covisible[i].keyframe);
  for (const KeyframeId id : around)
    writer_.submit(fuse(*writer_.snapshot(), id, grids_, options_.fuse));
  if (!hooks_.solve) return;
  const Snapshot map = writer_.snapshot();
  const std::array centres{loop.query, loop.candidate};
  const LocalWindow window = choose_local_window(*map, centres, options_.window);
  if (!window.free_keyframes.empty()) writer_.submit(hooks_.solve(*map, window, {}));
}

}  // namespace cairn
