// The pose graph as numbers, between the map and the solver. Private to server/optimize.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "server/optimize/pose_graph.h"

namespace cairn {

struct PoseGraphProblem {
  struct Node {
    KeyframeId id;
    Rigid3 initial;  // map_from_camera in the snapshot
    Sim3 state;      // map_from_camera; the scale is that of what the camera sees
    bool fixed = false;
  };
  struct Edge {
    std::uint32_t from = 0, to = 0;
    Sim3 to_from_from;
    double weight = 1;  // of the squared error
    bool is_loop = false;
    std::size_t loop = 0;  // index in the list of loops
    bool active = true;
  };

  std::vector<Node> nodes;
  std::vector<Edge> edges;
};

// Errors of an edge in its own standard deviations: norm over rotation, translation and scale.
double edge_error(const Sim3& map_from_from, const Sim3& map_from_to, const Sim3& to_from_from,
                  double weight, const PoseGraphOptions& options);
double edge_error(const PoseGraphProblem& problem, const PoseGraphProblem::Edge& edge,
                  const PoseGraphOptions& options);

// One round: moves the nodes' states, adds to the summary's iterations and sets its costs, message
// and `usable`. `robust`: loops pull with bounded force.
void solve_round(PoseGraphProblem& problem, const PoseGraphOptions& options, bool robust,
                 PoseGraphSummary& summary, const std::stop_token& stop);

}  // namespace cairn
