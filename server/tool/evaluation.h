// How far an estimated trajectory is from the true one.
//
// Definitions follow Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems", in
// the form that the program evo computes them:
// - pairs: each pose of the shorter trajectory takes the nearest in time of the longer one, one to
//   one, at most `max_diff_s` away
// - ATE: distances of the positions after aligning the estimate to the truth (Umeyama's method)
// - RPE: for pairs of poses `rpe_delta_s` apart in time, the error of the motion between them:
//   E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), Q the truth and P the estimate
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry/sim3.h"
#include "common/model/trajectory.h"
#include "common/util/status.h"

namespace cairn {

struct EvaluationOptions {
  bool with_scale = false;   // align with Sim(3) instead of SE(3)
  double max_diff_s = 0.02;  // of stamps that belong together
  double rpe_delta_s = 1.0;  // time over which drift is measured
  // Frames that the recording has, for the coverage; 0: judged by the time span of the truth.
  std::size_t frames = 0;
};

// Of a list of errors; all 0 for an empty one.
struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, min = 0, max = 0;
  std::size_t count = 0;
};
ErrorStatistics statistics_of(std::vector<double> errors);

struct Evaluation {
  std::size_t pairs = 0;
  ErrorStatistics ate;              // metres
  ErrorStatistics rpe_translation;  // metres over rpe_delta_s
  ErrorStatistics rpe_rotation;     // radians over rpe_delta_s
  // Share of the recording that has an estimate: number of estimated poses over options.frames, or
  // else the share of the truth's span in time during which the estimate goes on without a gap.
  double coverage = 0;
  double scale = 1;  // of truth_from_estimate, from a Sim(3) alignment even when not applied
  Sim3 truth_from_estimate;  // that was applied
};

// Indices into truth and estimate, ascending, of the poses that belong together.
struct IndexPair {
  std::size_t truth = 0, estimate = 0;
};
std::vector<IndexPair> associate(const Trajectory& truth, const Trajectory& estimate,
                                 double max_diff_s);

// Fails when fewer than three pairs are found, or when their positions lie on one line, so that no
// alignment is defined.
Result<Evaluation> evaluate(const Trajectory& truth, const Trajectory& estimate,
                            const EvaluationOptions& options = {});

// Estimate `i` with its own truth.
struct EvaluationInput {
  const Trajectory* truth = nullptr;
  const Trajectory* estimate = nullptr;
};
// Several trajectories that claim to share one frame, such as those of clients in a merged map: one
// alignment for all of them, errors of all taken together.
Result<Evaluation> evaluate_joint(std::span<const EvaluationInput> inputs,
                                  const EvaluationOptions& options = {});

}  // namespace cairn
