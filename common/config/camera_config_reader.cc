#include "common/config/camera_config_reader.h"

#include <cmath>

#include <Eigen/LU>

namespace cairn {
namespace {

constexpr double kMinSide = 16, kMaxSide = 16384;  // pixels
constexpr double kMaxFocal = 1e5;                  // pixels
constexpr double kMaxDistortion = 100;
constexpr Range kBaselineRange{0.001, 10};  // metres
// Calibration files print six digits or more; a tenth of a degree is still a slip of the keyboard.
constexpr double kRotationTolerance = 1e-3;

void check_intrinsics(Section& section, const std::array<double, 4>& k, int width, int height) {
  if (!section.ok()) return;
  const auto [fx, fy, cx, cy] = k;
  if (!(fx > 0 && fy > 0))
    section.fail("intrinsics", "fx and fy must be greater than 0");
  else if (fx > kMaxFocal || fy > kMaxFocal)
    section.fail("intrinsics", "fx and fy are in pixels and at most 100000");
  else if (cx < -width || cx > 2 * width || cy < -height || cy > 2 * height)
    section.fail("intrinsics", "cx and cy are far outside the image; is `resolution` right?");
}

std::array<double, 5> read_distortion(Section& section, LensModel lens) {
  std::array<double, 5> out{};
  if (!section.has("distortion")) return out;
  const bool fisheye = lens == LensModel::kFisheye;
  const char* names = fisheye ? "k1 k2 k3 k4, or none" : "k1 k2 p1 p2 k3, or without k3, or none";
  const auto list =
      section.numbers("distortion", 0, fisheye ? 4 : 5, names, {-kMaxDistortion, kMaxDistortion});
  if (!list.empty() && list.size() < 4)
    section.fail("distortion", "needs 4 numbers at least (" + std::string(names) + "), has " +
                                   std::to_string(list.size()));
  std::copy(list.begin(), list.end(), out.begin());
  return out;
}

Camera read_camera(Section& section) {
  const auto lens =
      section.choice_or("model", LensModel::kPinhole,
                        {{"pinhole", LensModel::kPinhole}, {"fisheye", LensModel::kFisheye}});
  const auto size = section.numbers<2>("resolution", "width height", {kMinSide, kMaxSide});
  if (size[0] != std::floor(size[0]) || size[1] != std::floor(size[1]))
    section.fail("resolution", "needs whole numbers of pixels");
  const int width = static_cast<int>(size[0]), height = static_cast<int>(size[1]);
  const auto intrinsics = section.numbers<4>("intrinsics", "fx fy cx cy");
  check_intrinsics(section, intrinsics, width, height);
  const auto distortion = read_distortion(section, lens);
  return Camera(lens, width, height, intrinsics, distortion);
}

Rigid3 read_transform(Section& section, std::string_view key) {
  const auto v = section.numbers<16>(key, "4x4 matrix, row by row");
  if (!section.ok()) return {};
  const Eigen::Matrix4d m =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(v.data());
  const Eigen::Matrix3d r = m.topLeftCorner<3, 3>();
  const double skewness = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (skewness > kRotationTolerance || r.determinant() < 0)
    section.fail(key, "the upper left 3x3 block is no rotation (columns must be orthonormal)");
  else if (m.row(3) != Eigen::RowVector4d(0, 0, 0, 1))
    section.fail(key, "the last row must be 0 0 0 1");
  if (!section.ok()) return {};
  return Rigid3::from_matrix(m);
}

CameraConfig::RightCamera read_right(Section& section, const Camera& left) {
  CameraConfig::RightCamera right{read_camera(section), read_transform(section, "left_from_right")};
  if (!section.ok()) return right;
  if (right.camera.width() != left.width() || right.camera.height() != left.height())
    section.fail("resolution", "must be the same as the left camera's");
  const double distance = right.left_from_right.translation.norm();
  if (distance < kBaselineRange.min || distance > kBaselineRange.max)
    section.fail("left_from_right", "the cameras must be 0.001 to 10 metres apart");
  return right;
}

void read_stereo(Section& camera, CameraConfig& config) {
  if (auto right = camera.optional_section("right"))
    config.right = read_right(*right, config.camera);
  if (!camera.ok() || config.sensor != Sensor::kStereo) return;
  if (camera.has("baseline_m") == config.right.has_value())
    camera.fail("baseline_m",
                "stereo needs either `baseline_m` (images rectified) or `right` (raw images)");
  else if (!config.right && config.camera.has_distortion())
    camera.fail("distortion",
                "`baseline_m` means rectified images, which have none; give `right` for raw ones");
}

}  // namespace

std::optional<Sensor> read_sensor(Section& root) {
  if (!root.has("sensor")) return std::nullopt;
  return root.choice<Sensor>(
      "sensor", {{"rgbd", Sensor::kRgbd}, {"stereo", Sensor::kStereo}, {"mono", Sensor::kMono}});
}

Result<CameraConfig> read_camera_config(Section& root) {
  CameraConfig config;
  config.sensor = read_sensor(root).value_or(config.sensor);
  Section camera = root.section("camera");
  config.camera = read_camera(camera);
  config.rate_hz = camera.number_or("rate_hz", config.rate_hz, {0.1, 1000});
  config.depth_scale = camera.number_or("depth_scale", config.depth_scale, {1e-3, 1e6});
  config.baseline_m = camera.number_or("baseline_m", config.baseline_m, kBaselineRange);
  read_stereo(camera, config);
  if (const Status status = root.status(); !status) return status.error();
  return config;
}

}  // namespace cairn
