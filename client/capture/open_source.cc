#include <filesystem>
#include <string>

#include "client/capture/frame_source.h"
#include "client/capture/image_reader.h"
#include "client/capture/read_ahead.h"
#include "client/capture/recordings.h"
#include "client/capture/rectifier.h"
#include "client/capture/synth_source.h"
#include "client/capture/video_source.h"

namespace cairn {
namespace {

// Reads the files of one moment. Any of them unusable: the whole frame is.
Produced load_frame(const FrameFiles& files, const CameraConfig& camera,
                    const std::optional<Rectifier>& rectifier) {
  const cv::Size size(camera.camera.width(), camera.camera.height());
  Frame frame;
  frame.stamp_ns = files.stamp_ns;
  auto gray = read_gray(files.gray, size);
  if (!gray) return Skipped{gray.message()};
  frame.gray = rectifier ? rectifier->left(*gray) : *gray;
  if (!files.right.empty()) {
    auto right = read_gray(files.right, size);
    if (!right) return Skipped{right.message()};
    frame.right = rectifier ? rectifier->right(*right) : *right;
  }
  if (!files.depth.empty()) {
    auto depth = read_depth(files.depth, size, camera.depth_scale);
    if (!depth) return Skipped{depth.message()};
    frame.depth = *depth;
  }
  return frame;
}

Result<std::unique_ptr<FrameSource>> play(const std::string& name, Result<Recording> recording) {
  if (!recording) return recording.error();
  CameraConfig delivered = recording->camera;
  std::optional<Rectifier> rectifier;
  if (delivered.sensor == Sensor::kStereo && delivered.right) {
    auto made = Rectifier::make(delivered);
    if (!made) return made.error();
    rectifier = std::move(*made);
    delivered = rectifier->camera();
  } else if (delivered.sensor == Sensor::kStereo && !(delivered.baseline_m > 0)) {
    return {ErrorCode::kInvalidArgument,
            "camera: stereo needs baseline_m (rectified pairs) or right (raw pairs)"};
  }
  const std::size_t count = recording->frames.size();
  auto produce = [frames = std::move(recording->frames), camera = recording->camera,
                  rectifier = std::move(rectifier), index = std::size_t{0}]() mutable -> Produced {
    if (index >= frames.size()) return EndOfFrames{};
    return load_frame(frames[index++], camera, rectifier);
  };
  return std::unique_ptr<FrameSource>(
      std::make_unique<ReadAhead>(name, delivered, count, std::move(produce)));
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_source(const std::string& spec,
                                                 const std::optional<CameraConfig>& config) {
  const auto colon = spec.find(':');
  const std::string kind = spec.substr(0, colon);
  const std::string rest = colon == std::string::npos ? "" : spec.substr(colon + 1);
  if (colon != std::string::npos && !rest.empty()) {
    if (kind == "tum") return play(spec, read_tum(rest, config));
    if (kind == "euroc") return play(spec, read_euroc(rest, config));
    if (kind == "kitti") return play(spec, read_kitti(rest, config));
    if (kind == "folder") return play(spec, read_folder(rest, config));
    if (kind == "video") return open_video(rest, config);
    if (kind == "camera") return open_camera(rest, config);
    if (kind == "synth") return open_synth(rest, config);
  }
  return {ErrorCode::kInvalidArgument,
          "input '" + spec +
              "': must be tum:DIR, euroc:DIR, kitti:DIR, folder:DIR, video:FILE, camera:N or "
              "synth:SCENE[?key=value&...]"};
}

}  // namespace cairn
