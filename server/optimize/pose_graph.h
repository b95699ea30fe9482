// Pose graph: brings the poses of a map into line with loops that were found (Mur-Artal et al.
// 2015, section VII D: the essential graph; Strasdat et al. 2010 for the scale).
//
// Nodes are keyframes. Edges are what the map holds to be true at present, the spanning tree and
// strong covisibility, as relative poses; and loops, earlier ones included, which contradict it.
// The solution spreads the contradiction over all edges. Landmarks move with their reference
// keyframe.
//
// Loops between components join them: each component is first put where the loops say it lies, so
// that it does not matter how far apart they were.
//
// A false loop that was not told from a true one earlier must not fold the map. First all loops
// pull with bounded force (Huber's loss), enough to strain the map by a few standard deviations at
// each keyframe but not to tear it; those that are then still far from being met contradict the
// others, or what lies between their ends, and are left out; the rest is solved without a bound. A
// false loop that asks for no more than a plausible drift can't be told here; not to let it in is
// what verification is for.
#pragma once

#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "common/geometry/sim3.h"
#include "server/map/delta.h"
#include "server/map/map.h"

namespace cairn {

// A loop: where keyframe `from` lies as seen from keyframe `to` (camera frames).
struct RelativePose {
  KeyframeId from, to;
  Sim3 to_from_from;
  double weight = 1;  // of its squared error, compared to that of an edge of the tree
};

struct PoseGraphOptions {
  // Keyframes that share so many landmarks get an edge besides the tree's. With less the graph is
  // denser than it pays for, with more it loosens (100 in Mur-Artal et al. 2015).
  int min_shared = 100;
  // Scale is another unknown, for maps of monocular cameras.
  bool with_scale = false;
  // How well neighbouring keyframes know their relative pose: what the errors are weighed with.
  double rotation_sigma = 0.003;    // radians
  double translation_sigma = 0.01;  // metres
  double scale_sigma = 0.01;        // of its logarithm
  // A loop counts like so many edges of a chain, or it would stay open by what it weighs less than
  // the map around it.
  double loop_weight = 100;
  // Both in standard deviations of a loop, which are 1/10 of an edge's with the weight above: from
  // where on it pulls no harder, and with how much left a loop is taken to be false. 5 cm or 0.9
  // degrees is far more than a true loop keeps once the map may bend towards it.
  double huber = 5;
  double max_error = 50;
  int max_iterations = 50;  // of each round
  double function_tolerance = 1e-6;
  int num_threads = 1;
};

struct PoseGraphSummary {
  bool usable = false;
  bool stopped = false;
  int keyframes = 0, edges = 0, loops = 0;
  int iterations = 0;
  double initial_cost = 0, final_cost = 0;
  double solve_ms = 0;
  // Indices of the loops that contradict the rest and were left out.
  std::vector<std::size_t> rejected;
  std::string message;
};

// `map` is the map before the loops' landmarks are fused: what it holds of the relative poses of
// keyframes that share landmarks must not be what the loops contradict.
//
// Loops that name keyframes which the map does not have are skipped. Components without a loop stay
// as they are. In each component that the loops make, the oldest keyframe of the `to` sides' former
// components is held.
//
// Runs on the snapshot alone, in any thread; with one thread the result is the same every time. The
// delta is empty (but for its base revision) when there is nothing to solve, the solver failed or
// it was asked to stop.
MapDelta solve_pose_graph(const Map& map, std::span<const RelativePose> loops,
                          const PoseGraphOptions& options, PoseGraphSummary* summary = nullptr,
                          std::stop_token stop = {});

}  // namespace cairn
