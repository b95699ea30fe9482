// Expected values are worked out by hand; the working stands beside them.
#include "server/tool/evaluation.h"

#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kTenth = 100'000'000;  // ns

// `count` poses, a tenth of a second apart.
Trajectory make(int count, const std::function<Rigid3(int)>& pose) {
  Trajectory out;
  for (int i = 0; i < count; ++i) out.push_back({1'000'000'000 + i * kTenth, pose(i)});
  return out;
}

// Corners of squares about the origin in the plane z = 0: sides 2 and 4 in turn. Errors in z of
// opposite sign at neighbouring corners cancel in every sum of Umeyama's covariance (sum z x =
// -e + -e + e + e = 0, same for y), so that the best alignment stays the identity.
Eigen::Vector3d corner(int i) {
  const double side = i / 4 % 2 ? 2 : 1;
  constexpr int kX[] = {-1, 1, 1, -1}, kY[] = {-1, -1, 1, 1};
  return side * Eigen::Vector3d(kX[i % 4], kY[i % 4], 0);
}
double sign(int i) {
  return i % 2 ? -1 : 1;
}
Rigid3 at(const Eigen::Vector3d& p) {
  return {Eigen::Quaterniond::Identity(), p};
}

TEST(Associate, TakesTheNearestWithinReach) {
  const auto stamps = [](std::initializer_list<int> ms) {
    Trajectory t;
    for (const int m : ms) t.push_back({m * 1'000'000LL, Rigid3()});
    return t;
  };
  // 100 -> 104 (4 ms away), 200 -> 190 (10 ms), 300: nearest 340 is 40 ms away.
  const auto pairs = associate(stamps({0, 80, 104, 190, 215, 340}), stamps({100, 200, 300}), 0.02);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].truth, 2u);
  EXPECT_EQ(pairs[0].estimate, 0u);
  EXPECT_EQ(pairs[1].truth, 3u);
  EXPECT_EQ(pairs[1].estimate, 1u);
  // The limit itself is inside.
  EXPECT_EQ(associate(stamps({120, 500}), stamps({100}), 0.02).size(), 1u);
  EXPECT_EQ(associate(stamps({121, 500}), stamps({100}), 0.02).size(), 0u);
}

TEST(Associate, IsOneToOneAndTheNearerRivalWins) {
  Trajectory estimate = {{100, {}}, {106, {}}}, truth = {{0, {}}, {104, {}}, {900, {}}};
  // Both are nearest to 104: 4 and 2 ns away.
  const auto pairs = associate(truth, estimate, 1);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].truth, 1u);
  EXPECT_EQ(pairs[0].estimate, 1u);
}

TEST(Associate, WorksWhicheverIsTheLongerOne) {
  const Trajectory few = {{100, {}}, {200, {}}}, many = {{0, {}}, {101, {}}, {150, {}}, {199, {}}};
  for (const auto& pair : associate(few, many, 1e-9)) {
    EXPECT_EQ(pair.estimate, pair.truth == 0 ? 1u : 3u);
  }
  EXPECT_EQ(associate(few, many, 1e-9).size(), 2u);
  EXPECT_EQ(associate(many, few, 1e-9).size(), 2u);
  EXPECT_TRUE(associate({}, few, 1).empty());
}

TEST(Statistics, OfAnEvenNumberTheMedianIsTheMiddle) {
  // rmse = sqrt((1 + 4 + 16 + 81) / 4) = sqrt(25.5)
  const ErrorStatistics e = statistics_of({4, 1, 9, 2});
  EXPECT_DOUBLE_EQ(e.rmse, std::sqrt(25.5));
  EXPECT_DOUBLE_EQ(e.mean, 4);
  EXPECT_DOUBLE_EQ(e.median, 3);
  EXPECT_DOUBLE_EQ(e.min, 1);
  EXPECT_DOUBLE_EQ(e.max, 9);
  EXPECT_EQ(e.count, 4u);
  EXPECT_EQ(statistics_of({}).count, 0u);
}

TEST(Evaluate, AMovedAndTurnedCopyHasNoError) {
  const Rigid3 moved(so3_exp({0.3, -1.2, 2.0}), {5, -3, 1});
  const Trajectory truth = make(8, [](int i) { return at(corner(i) + Eigen::Vector3d(0, 0, i)); });
  const Trajectory estimate = make(8, [&](int i) { return moved * truth[i].world_from_camera; });
  const auto result = evaluate(truth, estimate);
  ASSERT_TRUE(result.ok()) << result.message();
  EXPECT_EQ(result->pairs, 8u);
  EXPECT_NEAR(result->ate.rmse, 0, 1e-12);
  EXPECT_NEAR(result->scale, 1, 1e-12);
  EXPECT_TRUE((result->truth_from_estimate * Eigen::Vector3d(5, -3, 1)).isZero(1e-12));
}

TEST(Evaluate, AteOfKnownErrors) {
  // Errors of 0.1 m at the four inner corners and 0.3 m at the outer ones:
  // rmse = sqrt((4 * 0.01 + 4 * 0.09) / 8) = sqrt(0.05), mean = median = 0.2, max = 0.3.
  const Trajectory truth = make(8, [](int i) { return at(corner(i)); });
  const Trajectory estimate = make(8, [](int i) {
    return at(corner(i) + Eigen::Vector3d(0, 0, sign(i) * (i < 4 ? 0.1 : 0.3)));
  });
  const auto result = evaluate(truth, estimate);
  ASSERT_TRUE(result.ok()) << result.message();
  EXPECT_NEAR(result->ate.rmse, std::sqrt(0.05), 1e-12);
  EXPECT_NEAR(result->ate.mean, 0.2, 1e-12);
  EXPECT_NEAR(result->ate.median, 0.2, 1e-12);
  EXPECT_NEAR(result->ate.min, 0.1, 1e-12);
  EXPECT_NEAR(result->ate.max, 0.3, 1e-12);
}

TEST(Evaluate, ScaleCountsInSe3AndIsTakenOutInSim3) {
  // The estimate is half as large: a corner at distance sqrt(2) from the centre is estimated at
  // sqrt(2) / 2, which leaves an error of sqrt(2) / 2 = sqrt(0.5) each.
  const Trajectory truth = make(4, [](int i) { return at(corner(i)); });
  const Trajectory estimate = make(4, [](int i) { return at(0.5 * corner(i)); });
  const auto rigid = evaluate(truth, estimate);
  ASSERT_TRUE(rigid.ok());
  EXPECT_NEAR(rigid->ate.rmse, std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(rigid->scale, 2, 1e-12);
  EXPECT_EQ(rigid->truth_from_estimate.scale, 1);
  const auto similar = evaluate(truth, estimate, {.with_scale = true});
  ASSERT_TRUE(similar.ok());
  EXPECT_NEAR(similar->ate.rmse, 0, 1e-12);
  EXPECT_NEAR(similar->scale, 2, 1e-12);
}

TEST(Evaluate, RelativeErrorOfASpeedThatIsOff) {
  // 1 m/s along x, estimated as 1.1 m/s, with a zigzag in y that is the same after every second:
  // each second's motion is (1, 0, 0) in truth and (1.1, 0, 0) in the estimate, 0.1 m off.
  // 31 poses make 21 pairs that are 1 s apart.
  const auto path = [](double speed) {
    return make(31, [=](int i) { return at({speed * 0.1 * i, i % 2 * 0.5, 0}); });
  };
  const auto result = evaluate(path(1.0), path(1.1));
  ASSERT_TRUE(result.ok()) << result.message();
  EXPECT_EQ(result->rpe_translation.count, 21u);
  EXPECT_NEAR(result->rpe_translation.rmse, 0.1, 1e-12);
  EXPECT_NEAR(result->rpe_translation.median, 0.1, 1e-12);
  EXPECT_NEAR(result->rpe_translation.max, 0.1, 1e-12);
  EXPECT_NEAR(result->rpe_rotation.rmse, 0, 1e-7);
  // Over half a second the zigzag flips in both alike; 0.05 m are left, in 26 pairs.
  const auto half = evaluate(path(1.0), path(1.1), {.rpe_delta_s = 0.5});
  EXPECT_EQ(half->rpe_translation.count, 26u);
  EXPECT_NEAR(half->rpe_translation.rmse, 0.05, 1e-12);
}

TEST(Evaluate, RelativeErrorOfAHeadingThatDrifts) {
  // The estimate turns by 0.05 rad/s about z where the truth does not turn.
  const auto path = [](double rate) {
    return make(24, [=](int i) { return Rigid3(so3_exp({0, 0, rate * 0.1 * i}), corner(i)); });
  };
  const auto result = evaluate(path(0), path(0.05));
  ASSERT_TRUE(result.ok());
  EXPECT_NEAR(result->ate.rmse, 0, 1e-12);  // positions are right
  EXPECT_EQ(result->rpe_rotation.count, 14u);
  EXPECT_NEAR(result->rpe_rotation.rmse, 0.05, 1e-9);
  EXPECT_NEAR(result->rpe_rotation.max, 0.05, 1e-9);
}

TEST(Evaluate, RelativeErrorSkipsPairsThatAreNotThatFarApart) {
  // Poses at 0..0.4 s and 5..5.4 s: nothing is 1 s apart.
  Trajectory truth = make(10, [](int i) { return at(corner(i)); });
  for (int i = 5; i < 10; ++i) truth[i].stamp_ns += 4'500'000'000;
  const auto result = evaluate(truth, truth);
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->rpe_translation.count, 0u);
}

TEST(Evaluate, CoverageIsTheShareOfTimeWithAnEstimate) {
  // Truth from 0 to 9.9 s; poses 40..59 are missing from the estimate: 3.9 s + 3.9 s are tracked.
  const Trajectory truth = make(100, [](int i) { return at(corner(i)); });
  Trajectory estimate = truth;
  estimate.erase(estimate.begin() + 40, estimate.begin() + 60);
  EXPECT_NEAR(evaluate(truth, estimate)->coverage, 7.8 / 9.9, 1e-9);
  EXPECT_NEAR(evaluate(truth, truth)->coverage, 1, 1e-9);
  // By frames: 80 of 160.
  EXPECT_DOUBLE_EQ(evaluate(truth, estimate, {.frames = 160})->coverage, 0.5);
}

TEST(Evaluate, SaysWhyNothingCanBeEvaluated) {
  const Trajectory truth = make(8, [](int i) { return at(corner(i)); });
  Trajectory late = truth;
  for (auto& pose : late) pose.stamp_ns += 3'600'000'000'000;
  const auto no_pairs = evaluate(truth, late);
  ASSERT_FALSE(no_pairs.ok());
  EXPECT_THAT(no_pairs.message(), HasSubstr("only 0 poses"));
  const Trajectory line = make(8, [](int i) { return at({1.0 * i, 0, 0}); });
  ASSERT_FALSE(evaluate(line, line).ok());
  EXPECT_THAT(evaluate(line, line).message(), HasSubstr("one line"));
  EXPECT_FALSE(evaluate({}, truth).ok());
}

TEST(EvaluateJoint, OneAlignmentShowsWhatSeparateOnesHide) {
  // Two clients walk the same square; one is mapped 0.1 m too high and the other 0.1 m too low.
  // Each for itself is perfect. Together the best alignment is the identity: 0.1 m everywhere.
  const Trajectory truth = make(8, [](int i) { return at(corner(i)); });
  const auto shifted = [](double z) {
    return make(8, [=](int i) { return at(corner(i) + Eigen::Vector3d(0, 0, z)); });
  };
  const Trajectory high = shifted(0.1), low = shifted(-0.1);
  EXPECT_NEAR(evaluate(truth, high)->ate.rmse, 0, 1e-12);
  EXPECT_NEAR(evaluate(truth, low)->ate.rmse, 0, 1e-12);
  const EvaluationInput inputs[] = {{&truth, &high}, {&truth, &low}};
  const auto joint = evaluate_joint(inputs);
  ASSERT_TRUE(joint.ok());
  EXPECT_EQ(joint->pairs, 16u);
  EXPECT_NEAR(joint->ate.rmse, 0.1, 1e-12);
  EXPECT_NEAR(joint->ate.max, 0.1, 1e-12);
}

}  // namespace
}  // namespace cairn
