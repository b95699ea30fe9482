#include "tests/support/dataset_writer.h"

#include <array>
#include <fstream>
#include <string>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "common/model/trajectory.h"
#include "common/util/clock.h"

namespace cairn::synthetic {
namespace {

namespace fs = std::filesystem;

constexpr double kDepthScale = 5000;  // units a metre, as in the TUM recordings

constexpr const char* kPoseHeader = "# timestamp tx ty tz qx qy qz qw\n";

std::string seconds_text(std::int64_t ns) {
  return fmt::format("{}.{:06}", ns / kNanosPerSecond, ns % kNanosPerSecond / 1000);
}

Status write_image(const fs::path& file, const cv::Mat& image) {
  // Speed before size: these files are made to be read soon.
  const std::vector<int> parameters = {cv::IMWRITE_PNG_COMPRESSION, 1};
  bool written = false;
  try {
    written = cv::imwrite(file.string(), image, parameters);
  } catch (const cv::Exception&) {
    written = false;
  }
  if (!written) return {ErrorCode::kUnavailable, file.string() + ": can't be written"};
  return {};
}

Status write_text(const fs::path& file, const std::string& text) {
  std::ofstream stream(file);
  stream << text;
  stream.close();
  if (!stream) return {ErrorCode::kUnavailable, file.string() + ": can't be written"};
  return {};
}

Status make_folders(const fs::path& root, const std::vector<fs::path>& folders) {
  std::error_code error;
  if (fs::exists(root, error) && !fs::is_empty(root, error)) {
    return {ErrorCode::kInvalidArgument,
            root.string() + ": is not empty; choose a new folder or remove it first"};
  }
  for (const fs::path& folder : folders) {
    fs::create_directories(root / folder, error);
    if (error) {
      return {ErrorCode::kUnavailable, (root / folder).string() + ": " + error.message()};
    }
  }
  return {};
}

// Does `write` for each frame; stops at the first error or when `progress` says so.
Status for_each_frame(const SyntheticSequence& sequence, const WriteProgress& progress,
                      const std::function<Status(const SyntheticFrame&)>& write) {
  for (int i = 0; i < sequence.size(); ++i) {
    if (Status status = write(sequence.frame(i)); !status) return status;
    if (progress && !progress(i + 1)) return {ErrorCode::kUnavailable, "stopped"};
  }
  return {};
}

Status write_tum(const SyntheticSequence& sequence, const fs::path& root,
                 const WriteProgress& progress) {
  const Sensor sensor = sequence.options().sensor;
  const std::string partner = sensor == Sensor::kRgbd     ? "depth"
                              : sensor == Sensor::kStereo ? "right"
                                                          : "";
  std::vector<fs::path> folders = {"rgb"};
  if (!partner.empty()) folders.push_back(partner);
  if (Status status = make_folders(root, folders); !status) return status;
  std::string list = "# timestamp filename\n", partners = list;
  std::string poses = kPoseHeader;
  Status status = for_each_frame(sequence, progress, [&](const SyntheticFrame& frame) -> Status {
    const std::string stamp = seconds_text(frame.stamp_ns), name = stamp + ".png";
    list += stamp + " rgb/" + name + "\n";
    partners += stamp + " " + partner + "/" + name + "\n";
    poses += tum_line({frame.stamp_ns, frame.world_from_camera}) + '\n';
    if (Status written = write_image(root / "rgb" / name, frame.gray); !written) return written;
    if (partner.empty()) return {};
    cv::Mat image = frame.right;
    if (sensor == Sensor::kRgbd) frame.depth.convertTo(image, CV_16U, kDepthScale);
    return write_image(root / partner / name, image);
  });
  if (status) status = write_text(root / "rgb.txt", list);
  if (status && !partner.empty()) status = write_text(root / (partner + ".txt"), partners);
  if (status) status = write_text(root / "groundtruth.txt", poses);
  if (status) status = write_text(root / "client.yaml", client_config_text(sequence));
  return status;
}

// sensor.yaml of camera 0 or 1. The body frame is that of the left camera.
std::string euroc_sensor_text(const SyntheticSequence& sequence, int camera) {
  const Camera& lens = sequence.camera();
  const auto& [fx, fy, cx, cy] = lens.intrinsics();
  const auto& k = lens.distortion();
  const bool fisheye = lens.lens() == LensModel::kFisheye;
  return fmt::format(
      "%YAML:1.0\nsensor_type: camera\ncomment: synthetic, cam{}\n"
      "T_BS:\n  cols: 4\n  rows: 4\n"
      "  data: [1.0, 0.0, 0.0, {}, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\n"
      "rate_hz: {}\nresolution: [{}, {}]\ncamera_model: pinhole\n"
      "intrinsics: [{}, {}, {}, {}]\ndistortion_model: {}\n"
      "distortion_coefficients: [{}, {}, {}, {}{}]\n",
      camera, camera == 0 ? 0.0 : sequence.options().baseline_m, sequence.options().rate_hz,
      lens.width(), lens.height(), fx, fy, cx, cy, fisheye ? "equidistant" : "radial-tangential",
      k[0], k[1], k[2], k[3], fisheye ? "" : fmt::format(", {}", k[4]));
}

Status write_euroc(const SyntheticSequence& sequence, const fs::path& root,
                   const WriteProgress& progress) {
  const Sensor sensor = sequence.options().sensor;
  if (sensor == Sensor::kRgbd) {
    return {ErrorCode::kInvalidArgument, "the EuRoC layout has no depth; choose stereo or mono"};
  }
  const fs::path mav = root / "mav0", truth = "mav0/state_groundtruth_estimate0";
  std::vector<fs::path> folders = {"mav0/cam0/data", truth};
  if (sensor == Sensor::kStereo) folders.push_back("mav0/cam1/data");
  if (Status status = make_folders(root, folders); !status) return status;
  std::string list = "#timestamp [ns],filename\n";
  std::string poses = kPoseHeader;
  std::string states =
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
      "q_RS_z []\n";
  Status status = for_each_frame(sequence, progress, [&](const SyntheticFrame& frame) -> Status {
    const std::string name = fmt::format("{}.png", frame.stamp_ns);
    const auto& t = frame.world_from_camera.translation;
    const auto& q = frame.world_from_camera.rotation;
    list += fmt::format("{},{}\n", frame.stamp_ns, name);
    poses += tum_line({frame.stamp_ns, frame.world_from_camera}) + '\n';
    states += fmt::format("{},{:.7f},{:.7f},{:.7f},{:.8f},{:.8f},{:.8f},{:.8f}\n", frame.stamp_ns,
                          t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z());
    Status written = write_image(mav / "cam0" / "data" / name, frame.gray);
    if (!written || sensor != Sensor::kStereo) return written;
    return write_image(mav / "cam1" / "data" / name, frame.right);
  });
  for (int camera = 0; camera < (sensor == Sensor::kStereo ? 2 : 1) && status; ++camera) {
    const fs::path folder = mav / fmt::format("cam{}", camera);
    status = write_text(folder / "data.csv", list);
    if (status) status = write_text(folder / "sensor.yaml", euroc_sensor_text(sequence, camera));
  }
  if (status) status = write_text(root / truth / "data.csv", states);
  if (status) status = write_text(root / "groundtruth.txt", poses);
  return status;
}

}  // namespace

std::string client_config_text(const SyntheticSequence& sequence) {
  const SequenceOptions& options = sequence.options();
  const Camera& lens = sequence.camera();
  const auto& [fx, fy, cx, cy] = lens.intrinsics();
  const auto& k = lens.distortion();
  constexpr std::array<const char*, 3> kSensors = {"rgbd", "stereo", "mono"};
  const bool fisheye = lens.lens() == LensModel::kFisheye;
  std::string distortion;
  if (fisheye || lens.has_distortion()) {
    distortion = fmt::format("{}, {}, {}, {}", k[0], k[1], k[2], k[3]);
    if (!fisheye) distortion += fmt::format(", {}", k[4]);
  }
  std::string text = fmt::format(
      "sensor: {}\ncamera:\n  model: {}\n  resolution: [{}, {}]\n"
      "  intrinsics: [{}, {}, {}, {}]\n  distortion: [{}]\n  rate_hz: {}\n",
      kSensors[static_cast<std::size_t>(options.sensor)], fisheye ? "fisheye" : "pinhole",
      lens.width(), lens.height(), fx, fy, cx, cy, distortion, options.rate_hz);
  if (options.sensor == Sensor::kRgbd) text += fmt::format("  depth_scale: {}\n", kDepthScale);
  if (options.sensor == Sensor::kStereo) {
    text += fmt::format("  baseline_m: {}\n", options.baseline_m);
  }
  return text;
}

Status write_ground_truth(const SyntheticSequence& sequence, const fs::path& file) {
  std::string poses = kPoseHeader;
  for (int i = 0; i < sequence.size(); ++i) {
    poses += tum_line({sequence.stamp_ns(i), sequence.world_from_camera(i)}) + '\n';
  }
  return write_text(file, poses);
}

Status write_dataset(const SyntheticSequence& sequence, const fs::path& folder,
                     DatasetLayout layout, const WriteProgress& progress) {
  return layout == DatasetLayout::kTum ? write_tum(sequence, folder, progress)
                                       : write_euroc(sequence, folder, progress);
}

}  // namespace cairn::synthetic
