#include "server/optimize/reprojection.h"

#include <cmath>

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

Rig rig_of(Sensor sensor) {
  Rig rig;
  rig.sensor = sensor;
  rig.camera = {.fx = 520,
                .fy = 510,
                .cx = 320,
                .cy = 240,
                .width = 640,
                .height = 480,
                .baseline = sensor == Sensor::kMono ? 0.0 : 0.08};
  return rig;
}

Keyframe keyframe_of(const Rig& rig, float noise = 1) {
  Keyframe keyframe;
  keyframe.rig = std::make_shared<Rig>(rig);
  keyframe.noise = noise;
  return keyframe;
}

const Rigid3 kPose(so3_exp({0.2, -0.4, 0.1}), {3, -1, 0.5});
const Eigen::Vector3d kPointInCamera(0.4, -0.3, 2.5);

Feature feature_at(const Rig& rig, const Eigen::Vector3d& p, std::uint8_t octave) {
  const Eigen::Vector2d pixel = rig.camera.project(p);
  Feature feature;
  feature.x = static_cast<float>(pixel.x());
  feature.y = static_cast<float>(pixel.y());
  feature.octave = octave;
  if (rig.camera.baseline > 0) feature.disparity = static_cast<float>(rig.camera.disparity(p.z()));
  return feature;
}

Eigen::Vector3d errors_at(const Reprojection& term, const Rigid3& pose,
                          const Eigen::Vector3d& point) {
  Eigen::Vector3d errors = Eigen::Vector3d::Zero();
  term.evaluate(CameraPlace(pose), point, errors.data(), nullptr);
  return errors;
}

class ReprojectionOfSensor : public testing::TestWithParam<Sensor> {};
INSTANTIATE_TEST_SUITE_P(Sensors, ReprojectionOfSensor,
                         testing::Values(Sensor::kRgbd, Sensor::kStereo, Sensor::kMono));

TEST_P(ReprojectionOfSensor, IsZeroWhereTheFeatureWasFound) {
  const Rig rig = rig_of(GetParam());
  const Reprojection term(keyframe_of(rig), feature_at(rig, kPointInCamera, 2));
  EXPECT_EQ(term.rows(), GetParam() == Sensor::kMono ? 2 : 3);
  EXPECT_LT(errors_at(term, kPose, kPose * kPointInCamera).norm(), 1e-4);
}

TEST_P(ReprojectionOfSensor, DerivativesAgreeWithDifferences) {
  const Rig rig = rig_of(GetParam());
  Feature feature = feature_at(rig, kPointInCamera, 3);
  feature.x += 4;
  feature.y -= 2;
  const Reprojection term(keyframe_of(rig), feature);
  const Eigen::Vector3d point = kPose * kPointInCamera;
  double errors[3];
  Eigen::Vector3d rows[3] = {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero(),
                             Eigen::Vector3d::Zero()};
  const CameraPlace camera(kPose);
  ASSERT_TRUE(term.evaluate(camera, point, errors, rows));
  Eigen::Matrix<double, 3, 6> by_pose;
  Eigen::Matrix3d by_point;
  for (int row = 0; row < 3; ++row) {
    by_point.row(row) = rows[row];
    by_pose.row(row) << rows[row].cross(point - camera.centre).transpose(), -rows[row].transpose();
  }

  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    const Vector6 step = kStep * Vector6::Unit(i);
    const Eigen::Vector3d numeric = (errors_at(term, perturbed(kPose, step), point) -
                                     errors_at(term, perturbed(kPose, -step), point)) /
                                    (2 * kStep);
    EXPECT_LT((by_pose.col(i) - numeric).norm(), 1e-5 * (1 + numeric.norm())) << "direction " << i;
  }
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
    const Eigen::Vector3d numeric =
        (errors_at(term, kPose, point + step) - errors_at(term, kPose, point - step)) / (2 * kStep);
    EXPECT_LT((by_point.col(i) - numeric).norm(), 1e-5 * (1 + numeric.norm())) << "axis " << i;
  }
}

TEST(Reprojection, WeighsPixelsByOctaveAndDepthByTheSensor) {
  for (const Sensor sensor : {Sensor::kStereo, Sensor::kRgbd}) {
    const Rig rig = rig_of(sensor);
    Feature feature = feature_at(rig, kPointInCamera, 2);
    feature.x += 3;
    feature.disparity += 3;  // so that the right column is right
    const auto errors =
        errors_at(Reprojection(keyframe_of(rig), feature), kPose, kPose * kPointInCamera);
    EXPECT_NEAR(errors.x(), -3 / rig.pyramid.sigma(2), 1e-4);
    // A structured-light sensor's disparity is as good for coarse features as for fine ones.
    EXPECT_NEAR(errors.z(), sensor == Sensor::kRgbd ? -3 : 0, 1e-4);
  }
}

TEST(Reprojection, TrustsABlurredKeyframeLess) {
  const Rig rig = rig_of(Sensor::kRgbd);
  Feature feature = feature_at(rig, kPointInCamera, 1);
  feature.x += 3;
  feature.disparity += 2;
  const Eigen::Vector3d point = kPose * kPointInCamera;
  const auto sharp = errors_at(Reprojection(keyframe_of(rig), feature), kPose, point);
  const auto blurred = errors_at(Reprojection(keyframe_of(rig, 2.5f), feature), kPose, point);
  EXPECT_LT((sharp - 2.5 * blurred).norm(), 1e-6);
}

TEST(Reprojection, StereoMeasuresTheRightColumnAndRgbdTheDisparity) {
  for (const Sensor sensor : {Sensor::kStereo, Sensor::kRgbd}) {
    const Rig rig = rig_of(sensor);
    Feature feature = feature_at(rig, kPointInCamera, 0);
    feature.x += 2;  // the left column is wrong by 2, the disparity right: so is the right column
    const auto errors =
        errors_at(Reprojection(keyframe_of(rig), feature), kPose, kPose * kPointInCamera);
    EXPECT_NEAR(errors.z(), sensor == Sensor::kStereo ? -2 : 0, 1e-4);
  }
}

TEST(Reprojection, PointBehindTheCameraCountsAsAnOutlier) {
  const Rig rig = rig_of(Sensor::kRgbd);
  const Reprojection term(keyframe_of(rig), feature_at(rig, kPointInCamera, 0));
  const Eigen::Vector3d behind = kPose * Eigen::Vector3d(0.1, 0.1, -2);
  double errors[3];
  EXPECT_FALSE(term.evaluate(CameraPlace(kPose), behind, errors, nullptr));
  EXPECT_GT(errors[0], 1000);
  EXPECT_GT(term.chi2(CameraPlace(kPose), behind), term.chi2_limit());
}

}  // namespace
}  // namespace cairn
