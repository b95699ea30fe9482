#include "server/tool/evaluation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/util/clock.h"

namespace cairn {
namespace {

// Pairs of poses count as rpe_delta_s apart when they are within this share of it.
constexpr double kDeltaTolerance = 0.1;
// Between two estimated poses the camera counts as tracked when their distance in time is at most
// this many times the usual one.
constexpr double kMaxGap = 3.5;

// The pose nearest in time. `trajectory` is not empty.
std::size_t nearest(const Trajectory& trajectory, std::int64_t stamp_ns) {
  const auto after =
      std::lower_bound(trajectory.begin(), trajectory.end(), stamp_ns,
                       [](const StampedPose& pose, std::int64_t t) { return pose.stamp_ns < t; });
  const auto index = static_cast<std::size_t>(after - trajectory.begin());
  if (index == trajectory.size()) return index - 1;
  if (index == 0) return 0;
  const bool before_is_nearer =
      stamp_ns - trajectory[index - 1].stamp_ns <= trajectory[index].stamp_ns - stamp_ns;
  return before_is_nearer ? index - 1 : index;
}

struct Matched {
  const EvaluationInput* input;
  std::vector<IndexPair> pairs;

  const StampedPose& truth(std::size_t i) const { return (*input->truth)[pairs[i].truth]; }
  const StampedPose& estimate(std::size_t i) const { return (*input->estimate)[pairs[i].estimate]; }
};

std::optional<Sim3> alignment(const std::vector<Matched>& all, bool with_scale) {
  std::vector<Eigen::Vector3d> estimated, true_ones;
  for (const Matched& matched : all) {
    for (std::size_t i = 0; i < matched.pairs.size(); ++i) {
      estimated.push_back(matched.estimate(i).world_from_camera.origin());
      true_ones.push_back(matched.truth(i).world_from_camera.origin());
    }
  }
  return align_points(estimated, true_ones, with_scale);
}

void add_position_errors(const Matched& matched, const Sim3& truth_from_estimate,
                         std::vector<double>& errors) {
  for (std::size_t i = 0; i < matched.pairs.size(); ++i) {
    const Eigen::Vector3d aligned =
        truth_from_estimate * matched.estimate(i).world_from_camera.origin();
    errors.push_back((aligned - matched.truth(i).world_from_camera.origin()).norm());
  }
}

void add_relative_errors(const Matched& matched, const Sim3& truth_from_estimate, double delta_s,
                         std::vector<double>& translation, std::vector<double>& rotation) {
  const auto delta_ns = static_cast<std::int64_t>(delta_s * 1e9);
  const auto tolerance_ns = static_cast<std::int64_t>(kDeltaTolerance * delta_s * 1e9);
  Trajectory aligned;
  for (std::size_t i = 0; i < matched.pairs.size(); ++i) {
    const StampedPose& pose = matched.estimate(i);
    aligned.push_back({pose.stamp_ns, truth_from_estimate.move_pose(pose.world_from_camera)});
  }
  if (aligned.size() < 2) return;
  // Beyond the end the last pose would stand in for one that does not exist.
  const std::int64_t last = aligned.back().stamp_ns;
  const std::int64_t end = last + (last - aligned[aligned.size() - 2].stamp_ns) / 2;
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    const std::int64_t wanted = aligned[i].stamp_ns + delta_ns;
    if (wanted > end) break;
    const std::size_t j = nearest(aligned, wanted);
    if (j <= i || std::abs(aligned[j].stamp_ns - wanted) > tolerance_ns) continue;
    const Rigid3 true_motion =
        matched.truth(i).world_from_camera.inverse() * matched.truth(j).world_from_camera;
    const Rigid3 estimated_motion =
        aligned[i].world_from_camera.inverse() * aligned[j].world_from_camera;
    const Rigid3 error = true_motion.inverse() * estimated_motion;
    translation.push_back(error.translation.norm());
    rotation.push_back(rotation_angle(error));
  }
}

// Seconds of the truth's span during which the estimate goes on without a gap.
double tracked_seconds(const Trajectory& truth, const Trajectory& estimate) {
  std::vector<std::int64_t> steps;
  for (std::size_t i = 1; i < estimate.size(); ++i)
    steps.push_back(estimate[i].stamp_ns - estimate[i - 1].stamp_ns);
  if (steps.empty()) return 0;
  std::vector<std::int64_t> ordered = steps;
  std::nth_element(ordered.begin(), ordered.begin() + ordered.size() / 2, ordered.end());
  const double longest = kMaxGap * static_cast<double>(ordered[ordered.size() / 2]);
  std::int64_t tracked = 0;
  for (std::size_t i = 1; i < estimate.size(); ++i) {
    if (static_cast<double>(steps[i - 1]) > longest) continue;
    const std::int64_t from = std::max(estimate[i - 1].stamp_ns, truth.front().stamp_ns);
    const std::int64_t to = std::min(estimate[i].stamp_ns, truth.back().stamp_ns);
    tracked += std::max<std::int64_t>(0, to - from);
  }
  return to_seconds(tracked);
}

double coverage_of(std::span<const EvaluationInput> inputs, std::size_t frames) {
  double tracked = 0, span = 0;
  std::size_t poses = 0;
  for (const EvaluationInput& input : inputs) {
    poses += input.estimate->size();
    tracked += tracked_seconds(*input.truth, *input.estimate);
    span += to_seconds(input.truth->back().stamp_ns - input.truth->front().stamp_ns);
  }
  if (frames > 0) return static_cast<double>(poses) / static_cast<double>(frames);
  return span > 0 ? tracked / span : 0;
}

}  // namespace

ErrorStatistics statistics_of(std::vector<double> errors) {
  ErrorStatistics out;
  out.count = errors.size();
  if (errors.empty()) return out;
  std::sort(errors.begin(), errors.end());
  const auto n = static_cast<double>(errors.size());
  const std::size_t half = errors.size() / 2;
  out.rmse = std::sqrt(std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0) / n);
  out.mean = std::accumulate(errors.begin(), errors.end(), 0.0) / n;
  out.median = errors.size() % 2 ? errors[half] : (errors[half - 1] + errors[half]) / 2;
  out.min = errors.front();
  out.max = errors.back();
  return out;
}

std::vector<IndexPair> associate(const Trajectory& truth, const Trajectory& estimate,
                                 double max_diff_s) {
  if (truth.empty() || estimate.empty()) return {};
  const bool truth_is_shorter = truth.size() < estimate.size();
  const Trajectory& shorter = truth_is_shorter ? truth : estimate;
  const Trajectory& longer = truth_is_shorter ? estimate : truth;
  const auto max_diff_ns = static_cast<std::int64_t>(std::llround(max_diff_s * 1e9));
  const auto distance = [&](const IndexPair& pair) {
    return std::abs(truth[pair.truth].stamp_ns - estimate[pair.estimate].stamp_ns);
  };

  std::vector<IndexPair> pairs;
  for (std::size_t i = 0; i < shorter.size(); ++i) {
    const std::size_t j = nearest(longer, shorter[i].stamp_ns);
    const IndexPair pair = truth_is_shorter ? IndexPair{i, j} : IndexPair{j, i};
    if (distance(pair) > max_diff_ns) continue;
    // One to one: of two that want the same partner the nearer one gets it.
    const bool taken =
        !pairs.empty() && (truth_is_shorter ? pairs.back().estimate == j : pairs.back().truth == j);
    if (!taken)
      pairs.push_back(pair);
    else if (distance(pair) < distance(pairs.back()))
      pairs.back() = pair;
  }
  return pairs;
}

Result<Evaluation> evaluate_joint(std::span<const EvaluationInput> inputs,
                                  const EvaluationOptions& options) {
  Evaluation out;
  std::vector<Matched> all;
  for (const EvaluationInput& input : inputs) {
    if (input.truth->empty() || input.estimate->empty())
      return Error{ErrorCode::kInvalidArgument, "a trajectory without poses can't be evaluated"};
    all.push_back({&input, associate(*input.truth, *input.estimate, options.max_diff_s)});
    out.pairs += all.back().pairs.size();
  }
  if (out.pairs < 3)
    return Error{ErrorCode::kInvalidArgument,
                 "only " + std::to_string(out.pairs) +
                     " poses have a partner in time (3 needed); same clock in both files?"};
  const auto similarity = alignment(all, true);
  const auto applied = options.with_scale ? similarity : alignment(all, false);
  if (!similarity || !applied)
    return Error{ErrorCode::kInvalidArgument,
                 "the positions lie on one line or point: no alignment is defined"};
  out.scale = similarity->scale;
  out.truth_from_estimate = *applied;

  std::vector<double> positions, translations, rotations;
  for (const Matched& matched : all) {
    add_position_errors(matched, *applied, positions);
    add_relative_errors(matched, *applied, options.rpe_delta_s, translations, rotations);
  }
  out.ate = statistics_of(std::move(positions));
  out.rpe_translation = statistics_of(std::move(translations));
  out.rpe_rotation = statistics_of(std::move(rotations));
  out.coverage = coverage_of(inputs, options.frames);
  return out;
}

Result<Evaluation> evaluate(const Trajectory& truth, const Trajectory& estimate,
                            const EvaluationOptions& options) {
  const EvaluationInput input{&truth, &estimate};
  return evaluate_joint({&input, 1}, options);
}

}  // namespace cairn
