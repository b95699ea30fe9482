// KITTI odometry layout (Geiger, Lenz, Urtasun 2012): rectified grey pairs.
#include <array>
#include <fstream>
#include <sstream>
#include <string>

#include "client/capture/image_reader.h"
#include "client/capture/recordings.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

using Projection = std::array<double, 12>;  // 3x4, row by row

// The line "P0: 12 numbers" of calib.txt; nothing when it isn't there or isn't right.
std::optional<Projection> read_projection(const fs::path& file, const std::string& name) {
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line)) {
    std::istringstream fields(line);
    std::string key;
    if (!(fields >> key) || key != name + ":") continue;
    Projection projection{};
    for (double& value : projection) {
      if (!(fields >> value)) return std::nullopt;
    }
    return projection;
  }
  return std::nullopt;
}

Result<CameraConfig> read_calibration(const fs::path& folder, bool stereo,
                                      const fs::path& first_image) {
  const fs::path file = folder / "calib.txt";
  if (!fs::exists(file)) {
    return {ErrorCode::kNotFound,
            file.string() + ": not found; it is needed when the config has no camera"};
  }
  const auto left = read_projection(file, "P0");
  const auto right = read_projection(file, "P1");
  if (!left || (stereo && !right)) {
    return {ErrorCode::kCorrupt, file.string() + ": needs lines P0 and P1 with 12 numbers each"};
  }
  const Projection& p = *left;
  if (!(p[0] > 0 && p[5] > 0)) {
    return {ErrorCode::kCorrupt, file.string() + ": P0: focal lengths must be above 0"};
  }
  auto image = read_gray(first_image, {});
  if (!image) return image.error();
  CameraConfig config;
  config.sensor = stereo ? Sensor::kStereo : Sensor::kMono;
  config.rate_hz = 10;
  config.camera =
      Camera(LensModel::kPinhole, image->cols, image->rows, {p[0], p[5], p[2], p[6]}, {});
  if (!stereo) return config;
  // P1 = K [I | (-baseline, 0, 0)], relative to P0.
  config.baseline_m = (p[3] - (*right)[3]) / p[0];
  if (!(config.baseline_m > 0)) {
    return {ErrorCode::kCorrupt, file.string() + ": P1 gives no positive baseline"};
  }
  return config;
}

Result<std::vector<std::int64_t>> read_times(const fs::path& file) {
  std::ifstream stream(file);
  if (!stream) return {ErrorCode::kNotFound, file.string() + ": can't be read"};
  std::vector<std::int64_t> stamps;
  std::string word;
  while (stream >> word) {
    const auto stamp = parse_seconds(word);
    if (!stamp) {
      return {ErrorCode::kCorrupt, file.string() + ":" + std::to_string(stamps.size() + 1) + ": '" +
                                       word + "' is no time in seconds"};
    }
    stamps.push_back(*stamp);
  }
  return stamps;
}

}  // namespace

Result<Recording> read_kitti(const fs::path& folder, const std::optional<CameraConfig>& config) {
  if (config && config->sensor == Sensor::kRgbd) {
    return {ErrorCode::kInvalidArgument,
            "kitti:" + folder.string() + ": has no depth images; set sensor: stereo or mono"};
  }
  auto left = list_images(folder / "image_0");
  if (!left) return left.error();
  const bool stereo =
      config ? config->sensor == Sensor::kStereo : fs::is_directory(folder / "image_1");
  auto camera =
      config ? Result<CameraConfig>(*config) : read_calibration(folder, stereo, left->front());
  if (!camera) return camera.error();
  auto stamps = read_times(folder / "times.txt");
  if (!stamps) return stamps.error();
  if (stamps->size() < left->size()) {
    return {ErrorCode::kCorrupt, (folder / "times.txt").string() + ": has " +
                                     std::to_string(stamps->size()) + " times for " +
                                     std::to_string(left->size()) + " images"};
  }
  Recording recording{*camera, {}};
  for (std::size_t i = 0; i < left->size(); ++i) {
    FrameFiles frame{(*stamps)[i], (*left)[i], {}, {}};
    if (stereo) frame.right = folder / "image_1" / frame.gray.filename();
    recording.frames.push_back(std::move(frame));
  }
  return recording;
}

}  // namespace cairn
