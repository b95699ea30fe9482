#include <string>

#include "client/capture/recordings.h"
#include "common/util/log.h"

namespace cairn {
namespace {

constexpr std::int64_t kMaxGapNs = 20'000'000;

}  // namespace

Error camera_missing(const std::string& source) {
  return {ErrorCode::kInvalidArgument,
          source + ": has no calibration of its own; give the camera in the config (key camera)"};
}

Result<Recording> read_tum(const std::filesystem::path& folder,
                           const std::optional<CameraConfig>& config) {
  if (!std::filesystem::is_directory(folder)) {
    return {ErrorCode::kNotFound, folder.string() + ": no such folder"};
  }
  if (!config) return camera_missing("tum:" + folder.string());
  auto images = read_image_list(folder / "rgb.txt", folder, ListFormat::kTum);
  if (!images) return images.error();
  Recording recording{*config, {}};
  if (config->sensor == Sensor::kMono) {
    for (const ListedImage& image : *images) {
      recording.frames.push_back({image.stamp_ns, image.file, {}, {}});
    }
    return recording;
  }
  const bool stereo = config->sensor == Sensor::kStereo;
  const std::string name = stereo ? "right.txt" : "depth.txt";
  auto partners = read_image_list(folder / name, folder, ListFormat::kTum);
  if (!partners) {
    return {partners.error().code,
            partners.message() + " (needed for sensor: " + (stereo ? "stereo)" : "rgbd)")};
  }
  for (const auto& [i, j] : associate(*images, *partners, kMaxGapNs)) {
    FrameFiles frame{(*images)[i].stamp_ns, (*images)[i].file, {}, {}};
    (stereo ? frame.right : frame.depth) = (*partners)[j].file;
    recording.frames.push_back(std::move(frame));
  }
  if (recording.frames.empty()) {
    return {ErrorCode::kCorrupt, folder.string() + ": no images of rgb.txt and " + name +
                                     " are within 20 ms of each other"};
  }
  if (const auto alone = images->size() - recording.frames.size(); alone > 0) {
    log::info("{}: {} of {} images have no partner in {} within 20 ms and are left out",
              folder.string(), alone, images->size(), name);
  }
  return recording;
}

}  // namespace cairn
