#include "client/capture/rectifier.h"

#include <cmath>

#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace cairn {
namespace {

cv::Matx33d intrinsics(const Camera& camera) {
  const auto& [fx, fy, cx, cy] = camera.intrinsics();
  return {fx, 0, cx, 0, fy, cy, 0, 0, 1};
}

cv::Mat distortion(const Camera& camera) {
  const int count = camera.lens() == LensModel::kFisheye ? 4 : 5;
  cv::Mat result(1, count, CV_64F);
  for (int i = 0; i < count; ++i) result.at<double>(i) = camera.distortion()[i];
  return result;
}

struct Rectification {
  cv::Mat left_rotation, right_rotation;      // rectified from raw
  cv::Mat left_projection, right_projection;  // 3x4
};

Rectification rectify(const Camera& left, const Camera& right, const Rigid3& right_from_left) {
  const Eigen::Matrix3d turn = right_from_left.rotation.toRotationMatrix();
  cv::Matx33d rotation;
  cv::Vec3d translation;
  for (int i = 0; i < 3; ++i) {
    translation[i] = right_from_left.translation[i];
    for (int j = 0; j < 3; ++j) rotation(i, j) = turn(i, j);
  }
  const cv::Size size(left.width(), left.height());
  Rectification r;
  cv::Mat disparity_to_depth;
  if (left.lens() == LensModel::kFisheye) {
    cv::fisheye::stereoRectify(intrinsics(left), distortion(left), intrinsics(right),
                               distortion(right), size, rotation, translation, r.left_rotation,
                               r.right_rotation, r.left_projection, r.right_projection,
                               disparity_to_depth, cv::CALIB_ZERO_DISPARITY, size, 0.0, 1.0);
  } else {
    cv::stereoRectify(intrinsics(left), distortion(left), intrinsics(right), distortion(right),
                      size, rotation, translation, r.left_rotation, r.right_rotation,
                      r.left_projection, r.right_projection, disparity_to_depth,
                      cv::CALIB_ZERO_DISPARITY, 0.0, size);
  }
  return r;
}

void make_maps(const Camera& raw, const cv::Mat& rotation, const cv::Mat& projection, cv::Mat& map,
               cv::Mat& fraction) {
  const cv::Size size(raw.width(), raw.height());
  if (raw.lens() == LensModel::kFisheye) {
    cv::fisheye::initUndistortRectifyMap(intrinsics(raw), distortion(raw), rotation, projection,
                                         size, CV_16SC2, map, fraction);
  } else {
    cv::initUndistortRectifyMap(intrinsics(raw), distortion(raw), rotation, projection, size,
                                CV_16SC2, map, fraction);
  }
}

Status check_pair(const CameraConfig& raw) {
  const Camera &left = raw.camera, &right = raw.right->camera;
  if (left.lens() != right.lens()) {
    return {ErrorCode::kInvalidArgument, "stereo: both cameras must be of the same model"};
  }
  if (left.width() != right.width() || left.height() != right.height()) {
    return {ErrorCode::kInvalidArgument, "stereo: both cameras must have the same resolution"};
  }
  const Eigen::Vector3d offset = raw.right->left_from_right.translation;
  if (offset.x() <= 0 || std::abs(offset.x()) < offset.tail<2>().norm()) {
    return {ErrorCode::kInvalidArgument,
            "stereo: left_from_right must put the right camera to the right of the left one"};
  }
  return {};
}

}  // namespace

Result<Rectifier> Rectifier::make(const CameraConfig& raw) {
  if (Status status = check_pair(raw); !status) return status.error();
  Rectifier result;
  result.camera_ = raw;
  result.camera_.right.reset();
  try {
    const Rectification r =
        rectify(raw.camera, raw.right->camera, raw.right->left_from_right.inverse());
    make_maps(raw.camera, r.left_rotation, r.left_projection, result.left_map_,
              result.left_fraction_);
    make_maps(raw.right->camera, r.right_rotation, r.right_projection, result.right_map_,
              result.right_fraction_);
    const cv::Mat& p = r.left_projection;
    result.camera_.camera = Camera(
        LensModel::kPinhole, raw.camera.width(), raw.camera.height(),
        {p.at<double>(0, 0), p.at<double>(1, 1), p.at<double>(0, 2), p.at<double>(1, 2)}, {});
    // The right camera's projection holds -fx * baseline (in the unit of left_from_right).
    result.camera_.baseline_m =
        -r.right_projection.at<double>(0, 3) / r.right_projection.at<double>(0, 0);
  } catch (const cv::Exception& error) {
    return {ErrorCode::kInvalidArgument, "stereo: no rectification found: " + error.err};
  }
  const double focal = result.camera_.camera.intrinsics()[0];
  if (!(std::isfinite(focal) && focal > 0 && result.camera_.baseline_m > 0)) {
    return {ErrorCode::kInvalidArgument, "stereo: these two cameras can't be rectified"};
  }
  return result;
}

cv::Mat Rectifier::left(const cv::Mat& raw) const {
  cv::Mat result;
  cv::remap(raw, result, left_map_, left_fraction_, cv::INTER_LINEAR);
  return result;
}

cv::Mat Rectifier::right(const cv::Mat& raw) const {
  cv::Mat result;
  cv::remap(raw, result, right_map_, right_fraction_, cv::INTER_LINEAR);
  return result;
}

}  // namespace cairn
