// Ground truth of synthetic runs, and how far a client's trajectory is from it.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/model/trajectory.h"
#include "server/tool/evaluation.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::testing {

// Ground truth of all frames of a synthetic sequence.
inline Trajectory truth_of(const synthetic::SequenceOptions& options) {
  const auto sequence = synthetic::SyntheticSequence::make(options);
  EXPECT_TRUE(sequence.ok());
  Trajectory truth;
  if (!sequence.ok()) return truth;
  for (int i = 0; i < (*sequence)->size(); ++i)
    truth.push_back({(*sequence)->stamp_ns(i), (*sequence)->world_from_camera(i)});
  return truth;
}

// ATE etc. of a trajectory file, aligned without scale; a failure when it can't be had.
inline Evaluation evaluate_file(const Trajectory& truth, const std::string& estimate_file) {
  const Result<Trajectory> estimate = read_trajectory(estimate_file);
  EXPECT_TRUE(estimate.ok()) << estimate.message();
  if (!estimate.ok()) return {};
  const Result<Evaluation> evaluation = evaluate(truth, *estimate);
  EXPECT_TRUE(evaluation.ok()) << evaluation.message();
  return evaluation.ok() ? *evaluation : Evaluation{};
}

// What one of several clients should have seen, and the file that it wrote.
struct JointRun {
  Trajectory truth;
  std::string file;
};

// RMSE of the ATE of all clients with one alignment, metres: small only when they are in one frame.
// A failure, and infinity, when it can't be had.
inline double joint_ate(const std::vector<JointRun>& runs) {
  std::vector<Trajectory> estimates;
  for (const JointRun& run : runs) {
    const Result<Trajectory> estimate = read_trajectory(run.file);
    EXPECT_TRUE(estimate.ok()) << estimate.message();
    if (!estimate.ok()) return std::numeric_limits<double>::infinity();
    estimates.push_back(*estimate);
  }
  std::vector<EvaluationInput> inputs;
  for (std::size_t i = 0; i < runs.size(); ++i) inputs.push_back({&runs[i].truth, &estimates[i]});
  const Result<Evaluation> evaluation = evaluate_joint(inputs);
  EXPECT_TRUE(evaluation.ok()) << evaluation.message();
  return evaluation.ok() ? evaluation->ate.rmse : std::numeric_limits<double>::infinity();
}

}  // namespace cairn::testing
