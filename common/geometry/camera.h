// Camera models.
//
// A Camera is what a calibration describes: lens distortion included. Features are undistorted
// once, in the client's front end; from there on everything (tracking, wire, map, optimisation)
// works in the PinholeCamera, the ideal camera with the same focal length and no distortion.
//
// Camera frame: x right, y down, z forward (metres). Pixels: (0, 0) is the centre of the top left
// pixel.
#pragma once

#include <array>
#include <optional>

#include <Eigen/Core>

namespace cairn {

// Ideal pinhole camera, for stereo and RGB-D with the baseline of a rectified pair: a point at
// depth z has the disparity fx * baseline / z. RGB-D sensors have a virtual baseline, which only
// sets how the weight of depth falls with distance.
struct PinholeCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  int width = 0, height = 0;              // pixels
  double baseline = 0;                    // metres; 0: monocular

  Eigen::Vector2d project(const Eigen::Vector3d& p) const {
    return {fx * p.x() / p.z() + cx, fy * p.y() / p.z() + cy};
  }
  // The point at depth z (metres) that projects to `pixel`.
  Eigen::Vector3d unproject(const Eigen::Vector2d& pixel, double z) const {
    return {(pixel.x() - cx) / fx * z, (pixel.y() - cy) / fy * z, z};
  }
  double disparity(double z) const { return fx * baseline / z; }
  double depth(double disparity_px) const { return fx * baseline / disparity_px; }
  // d(u, v, disparity) / d(point in camera). Needs p.z() > 0.
  Eigen::Matrix3d projection_jacobian(const Eigen::Vector3d& p) const;
  bool operator==(const PinholeCamera&) const = default;
};

enum class LensModel { kPinhole, kFisheye };

// A calibrated lens. kPinhole: radial-tangential distortion k1 k2 p1 p2 k3 (Brown 1966, as in
// OpenCV). kFisheye: equidistant, k1..k4 (Kannala and Brandt 2006, as in OpenCV's fisheye module).
class Camera {
 public:
  Camera() = default;
  Camera(LensModel lens, int width, int height, const std::array<double, 4>& fx_fy_cx_cy,
         const std::array<double, 5>& distortion)
      : lens_(lens),
        width_(width),
        height_(height),
        intrinsics_(fx_fy_cx_cy),
        distortion_(distortion) {}

  LensModel lens() const { return lens_; }
  int width() const { return width_; }
  int height() const { return height_; }
  const std::array<double, 4>& intrinsics() const { return intrinsics_; }
  const std::array<double, 5>& distortion() const { return distortion_; }
  bool has_distortion() const;

  // Nothing for points behind a pinhole, or where the lens model folds back.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_camera) const;
  // d(pixel) / d(point in camera); zero where project() gives nothing.
  Eigen::Matrix<double, 2, 3> projection_jacobian(const Eigen::Vector3d& point_in_camera) const;
  // Direction (unit length) seen at a pixel. Newton iterations; nothing where they don't converge.
  std::optional<Eigen::Vector3d> unproject(const Eigen::Vector2d& pixel) const;
  // Where the ideal pinhole with the same intrinsics sees what this camera sees at `pixel`; nothing
  // for directions 80 degrees or more off the axis.
  std::optional<Eigen::Vector2d> undistort(const Eigen::Vector2d& pixel) const;

  // The ideal camera that undistorted features belong to. `baseline` in metres.
  PinholeCamera ideal(double baseline) const;

 private:
  LensModel lens_ = LensModel::kPinhole;
  int width_ = 0, height_ = 0;
  std::array<double, 4> intrinsics_{};
  std::array<double, 5> distortion_{};
};

}  // namespace cairn
