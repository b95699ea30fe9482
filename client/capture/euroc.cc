// EuRoC MAV layout (Burri et al. 2016, "The EuRoC micro aerial vehicle datasets").
#include <algorithm>
#include <fstream>
#include <sstream>
#include <string>

#include "client/capture/recordings.h"
#include "common/config/yaml_reader.h"
#include "common/util/log.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxGapNs = 20'000'000;

struct SensorFile {
  Camera camera;
  double rate_hz = 20;
  Rigid3 body_from_camera;
};

// The data set's files open with "%YAML:1.0", which OpenCV writes and YAML forbids.
Result<std::string> read_without_directive(const fs::path& file) {
  std::ifstream stream(file);
  if (!stream) {
    return {ErrorCode::kNotFound,
            file.string() + ": can't be read; it is needed when the config has no camera"};
  }
  std::stringstream text;
  text << stream.rdbuf();
  std::string content = text.str();
  if (content.starts_with('%')) content[0] = '#';
  return content;
}

Result<SensorFile> read_sensor_file(const fs::path& file) {
  auto text = read_without_directive(file);
  if (!text) return text.error();
  auto root = parse_yaml(*text, file.string());
  if (!root) return root.error();
  SensorFile sensor;
  const auto size = root->numbers<2>("resolution", "width height", {16, 16384});
  const auto pixels = root->numbers<4>("intrinsics", "fu fv cu cv", {-1e6, 1e6});
  const auto given = root->numbers("distortion_coefficients", 4, 5, "distortion", {-1e3, 1e3});
  const auto lens =
      root->choice<LensModel>("distortion_model", {{"radial-tangential", LensModel::kPinhole},
                                                   {"radtan", LensModel::kPinhole},
                                                   {"equidistant", LensModel::kFisheye}});
  sensor.rate_hz = root->number_or("rate_hz", 20, {0.1, 1000});
  const auto pose = root->section("T_BS").numbers<16>("data", "the 4x4 matrix", {-1e6, 1e6});
  if (root->ok() && !(pixels[0] > 0 && pixels[1] > 0)) {
    root->fail("intrinsics", "focal lengths must be above 0");
  }
  if (Status status = root->status(); !status) return status.error();
  std::array<double, 5> distortion{};
  std::copy(given.begin(), given.end(), distortion.begin());
  sensor.camera =
      Camera(lens, static_cast<int>(size[0]), static_cast<int>(size[1]), pixels, distortion);
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(pose.data());
  sensor.body_from_camera = Rigid3::from_matrix(matrix);
  return sensor;
}

Result<CameraConfig> read_calibration(const fs::path& root, bool stereo) {
  auto left = read_sensor_file(root / "cam0" / "sensor.yaml");
  if (!left) return left.error();
  CameraConfig config;
  config.sensor = stereo ? Sensor::kStereo : Sensor::kMono;
  config.camera = left->camera;
  config.rate_hz = left->rate_hz;
  if (!stereo) return config;
  auto right = read_sensor_file(root / "cam1" / "sensor.yaml");
  if (!right) return right.error();
  config.right = CameraConfig::RightCamera{
      right->camera, left->body_from_camera.inverse() * right->body_from_camera};
  return config;
}

}  // namespace

Result<Recording> read_euroc(const fs::path& folder, const std::optional<CameraConfig>& config) {
  const fs::path root = fs::is_directory(folder / "mav0") ? folder / "mav0" : folder;
  if (!fs::is_directory(root / "cam0")) {
    return {ErrorCode::kNotFound, folder.string() + ": no folder mav0/cam0 in it"};
  }
  if (config && config->sensor == Sensor::kRgbd) {
    return {ErrorCode::kInvalidArgument,
            "euroc:" + folder.string() + ": has no depth images; set sensor: stereo or mono"};
  }
  const bool stereo = config ? config->sensor == Sensor::kStereo : fs::is_directory(root / "cam1");
  auto camera = config ? Result<CameraConfig>(*config) : read_calibration(root, stereo);
  if (!camera) return camera.error();
  Recording recording{*camera, {}};
  const auto read_list = [&](const char* name) {
    const fs::path base = root / name;
    return read_image_list(base / "data.csv", base / "data", ListFormat::kEuroc);
  };
  auto left = read_list("cam0");
  if (!left) return left.error();
  if (!stereo) {
    for (const ListedImage& image : *left) {
      recording.frames.push_back({image.stamp_ns, image.file, {}, {}});
    }
    return recording;
  }
  auto right = read_list("cam1");
  if (!right) return right.error();
  for (const auto& [i, j] : associate(*left, *right, kMaxGapNs)) {
    recording.frames.push_back({(*left)[i].stamp_ns, (*left)[i].file, (*right)[j].file, {}});
  }
  if (recording.frames.empty()) {
    return {ErrorCode::kCorrupt, folder.string() + ": no images of cam0 and cam1 belong together"};
  }
  if (const auto alone = left->size() - recording.frames.size(); alone > 0) {
    log::info("{}: {} of {} images of cam0 have no partner in cam1 and are left out",
              folder.string(), alone, left->size());
  }
  return recording;
}

}  // namespace cairn
