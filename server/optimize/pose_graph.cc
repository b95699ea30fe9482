#include "server/optimize/pose_graph.h"

#include <algorithm>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <unordered_map>

#include "common/util/clock.h"
#include "server/optimize/component.h"
#include "server/optimize/pose_graph_problem.h"

namespace cairn {
namespace {

using Node = PoseGraphProblem::Node;
using Edge = PoseGraphProblem::Edge;

Sim3 without_scale(Sim3 transform, bool with_scale) {
  if (!with_scale) transform.scale = 1;
  return transform;
}

// Builds the problem: which components take part, their edges, what is held, where each component
// lies to begin with.
class GraphBuilder {
 public:
  GraphBuilder(const Map& map, std::span<const RelativePose> loops, const PoseGraphOptions& options)
      : map_(map), options_(options) {
    for (std::size_t i = 0; i < loops.size(); ++i) add_part_of_loop(loops, i);
    for (const std::size_t i : usable_) add_loop(loops[i], i);
    place_parts();
    add_map_edges();
  }

  PoseGraphProblem take() { return std::move(problem_); }

 private:
  struct Part {
    std::uint32_t first = 0, count = 0;  // nodes
    KeyframeId oldest;
    bool is_candidate = false;  // a loop's `to` is in it
    bool placed = false;
  };

  void add_part_of_loop(std::span<const RelativePose> loops, std::size_t i) {
    const RelativePose& loop = loops[i];
    if (loop.from == loop.to || !map_.keyframes.contains(loop.from) ||
        !map_.keyframes.contains(loop.to) || !(loop.weight > 0))
      return;
    usable_.push_back(i);
    add_part(loop.from);
    add_part(loop.to);
  }

  void add_part(KeyframeId id) {
    if (index_.contains(id)) return;
    const std::vector<KeyframeId> ids = component_of(map_, id);
    Part part{.first = static_cast<std::uint32_t>(problem_.nodes.size()),
              .count = static_cast<std::uint32_t>(ids.size()),
              .oldest = oldest(map_, ids)};
    for (const KeyframeId member : ids) {
      const Rigid3& pose = map_.keyframes.at(member).map_from_camera;
      index_[member] = static_cast<std::uint32_t>(problem_.nodes.size());
      part_of_.push_back(parts_.size());
      problem_.nodes.push_back({member, pose, Sim3(pose), false});
    }
    parts_.push_back(part);
  }

  void add_loop(const RelativePose& loop, std::size_t i) {
    const std::uint32_t from = index_.at(loop.from), to = index_.at(loop.to);
    parts_[part_of_[to]].is_candidate = true;
    problem_.edges.push_back({from, to, without_scale(loop.to_from_from, options_.with_scale),
                              options_.loop_weight * loop.weight, true, i});
  }

  // Holds one keyframe of what hangs together by loops, and puts the rest where loops say it lies.
  void place_parts() {
    while (true) {
      Part* start = nullptr;
      for (Part& part : parts_)
        if (!part.placed && (!start || rank(part) < rank(*start))) start = &part;
      if (!start) return;
      start->placed = true;
      problem_.nodes[index_.at(start->oldest)].fixed = true;
      while (place_next()) {
      }
    }
  }

  // Candidates' sides first, of those the oldest.
  std::tuple<bool, std::uint64_t, std::int64_t, KeyframeId> rank(const Part& part) const {
    const KeyframeNode& node = map_.keyframes.at(part.oldest);
    return {!part.is_candidate, node.arrival, node.keyframe->stamp_ns, part.oldest};
  }

  // Places one part next to those that are; false when no loop leads to another one.
  bool place_next() {
    std::map<std::size_t, std::vector<const Edge*>> leading;  // by part
    for (const Edge& edge : problem_.edges) {
      const std::size_t from = part_of_[edge.from], to = part_of_[edge.to];
      if (parts_[from].placed != parts_[to].placed)
        leading[parts_[from].placed ? to : from].push_back(&edge);
    }
    if (leading.empty()) return false;
    const auto& [part, edges] = *leading.begin();
    move(parts_[part], best_move(edges));
    parts_[part].placed = true;
    return true;
  }

  // By which transform of the unplaced side the loops are met best: of those that meet one of them,
  // the one that leaves the least bounded error in the others.
  Sim3 best_move(const std::vector<const Edge*>& edges) const {
    Sim3 best;
    double least = std::numeric_limits<double>::infinity();
    for (const Edge* exact : edges) {
      const Sim3 move = move_to_meet(*exact);
      double sum = 0;
      for (const Edge* edge : edges) sum += std::min(error_after(*edge, move), options_.max_error);
      if (sum >= least) continue;
      least = sum;
      best = move;
    }
    return best;
  }

  bool from_is_placed(const Edge& edge) const { return parts_[part_of_[edge.from]].placed; }

  Sim3 move_to_meet(const Edge& edge) const {
    const Sim3& from = problem_.nodes[edge.from].state;
    const Sim3& to = problem_.nodes[edge.to].state;
    return from_is_placed(edge) ? from * edge.to_from_from.inverse() * to.inverse()
                                : to * edge.to_from_from * from.inverse();
  }

  double error_after(const Edge& edge, const Sim3& move) const {
    const Sim3& from = problem_.nodes[edge.from].state;
    const Sim3& to = problem_.nodes[edge.to].state;
    const bool moves_to = from_is_placed(edge);
    return edge_error(moves_to ? from : move * from, moves_to ? move * to : to, edge.to_from_from,
                      edge.weight, options_);
  }

  void move(const Part& part, const Sim3& by) {
    for (std::uint32_t i = part.first; i < part.first + part.count; ++i)
      problem_.nodes[i].state = by * problem_.nodes[i].state;
  }

  // Spanning tree and strong covisibility, as they are in the map. Relative poses of keyframes that
  // see the same things are no independent measurements: the more a keyframe has of them the less
  // each counts, and a dense part of the map is not stiffer than a sparse one.
  void add_map_edges() {
    std::set<std::pair<std::uint32_t, std::uint32_t>> pairs;
    for (std::uint32_t i = 0; i < problem_.nodes.size(); ++i) {
      const KeyframeNode& node = map_.keyframes.at(problem_.nodes[i].id);
      if (const auto parent = index_.find(node.parent); parent != index_.end())
        pairs.insert(std::minmax(i, parent->second));
      for (const Covisible& c : node.covisible) {
        if (c.shared < options_.min_shared) break;
        if (const auto other = index_.find(c.keyframe); other != index_.end())
          pairs.insert(std::minmax(i, other->second));
      }
    }
    std::vector<int> degree(problem_.nodes.size(), 0);
    for (const auto& [a, b] : pairs) {
      ++degree[a];
      ++degree[b];
    }
    for (const auto& [a, b] : pairs) {
      const Rigid3 b_from_a = problem_.nodes[b].initial.inverse() * problem_.nodes[a].initial;
      problem_.edges.push_back({a, b, Sim3(b_from_a), 4.0 / (degree[a] + degree[b])});
    }
  }

  const Map& map_;
  const PoseGraphOptions& options_;
  PoseGraphProblem problem_;
  std::vector<std::size_t> usable_;  // loops
  std::vector<Part> parts_;
  std::vector<std::size_t> part_of_;  // one a node
  std::unordered_map<KeyframeId, std::uint32_t> index_;
};

// Loops are active when they agree with the state; true when that has changed for any.
bool judge_loops(PoseGraphProblem& problem, const PoseGraphOptions& options) {
  bool changed = false;
  for (Edge& edge : problem.edges) {
    if (!edge.is_loop) continue;
    const bool agrees = edge_error(problem, edge, options) <= options.max_error;
    changed |= agrees != edge.active;
    edge.active = agrees;
  }
  return changed;
}

void solve(PoseGraphProblem& problem, const PoseGraphOptions& options, PoseGraphSummary& summary,
           const std::stop_token& stop) {
  const auto go_on = [&] { return summary.usable && !stop.stop_requested(); };
  solve_round(problem, options, true, summary, stop);
  if (!go_on()) return;
  judge_loops(problem, options);
  solve_round(problem, options, false, summary, stop);
  // A loop that a false one kept from being met gets another chance, and the other way round.
  if (go_on() && judge_loops(problem, options)) solve_round(problem, options, false, summary, stop);
}

MapDelta make_delta(const Map& map, const PoseGraphProblem& problem) {
  MapDelta delta = MapDelta::based_on(map);
  for (const Node& node : problem.nodes) {
    if (node.fixed) continue;
    const Rigid3 pose{node.state.rotation, node.state.translation};
    delta.poses.push_back({node.id, node.initial, pose, node.state.scale});
    const Sim3 move = node.state * Sim3(node.initial).inverse();
    for (const LandmarkId id : map.keyframes.at(node.id).landmarks) {
      const Landmark* landmark = id.is_valid() ? map.landmarks.find(id) : nullptr;
      if (landmark && landmark->reference == node.id)
        delta.positions.push_back({id, move * landmark->position});
    }
  }
  return delta;
}

}  // namespace

MapDelta solve_pose_graph(const Map& map, std::span<const RelativePose> loops,
                          const PoseGraphOptions& options, PoseGraphSummary* summary,
                          std::stop_token stop) {
  const Stopwatch watch;
  PoseGraphProblem problem = GraphBuilder(map, loops, options).take();
  PoseGraphSummary result;
  result.keyframes = static_cast<int>(problem.nodes.size());
  result.edges = static_cast<int>(problem.edges.size());
  for (const Edge& edge : problem.edges) result.loops += edge.is_loop ? 1 : 0;
  if (result.loops == 0) {
    result.usable = true;
    result.message = "nothing to solve: no loop between two keyframes of the map";
  } else {
    solve(problem, options, result, stop);
  }
  for (const Edge& edge : problem.edges)
    if (edge.is_loop && !edge.active) result.rejected.push_back(edge.loop);
  result.stopped = stop.stop_requested();
  result.solve_ms = watch.milliseconds();
  const bool solved = result.usable && !result.stopped && result.loops > 0;
  if (summary) *summary = result;
  return solved ? make_delta(map, problem) : MapDelta::based_on(map);
}

}  // namespace cairn
