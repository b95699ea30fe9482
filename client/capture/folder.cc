#include <cmath>
#include <string>

#include "client/capture/recordings.h"

namespace cairn {

Result<Recording> read_folder(const std::filesystem::path& folder,
                              const std::optional<CameraConfig>& config) {
  auto images = list_images(folder);
  if (!images) return images.error();
  if (!config) return camera_missing("folder:" + folder.string());
  if (config->sensor != Sensor::kMono) {
    return {ErrorCode::kInvalidArgument,
            "folder:" + folder.string() + ": holds single images; set sensor: mono"};
  }
  Recording recording{*config, {}};
  for (std::size_t i = 0; i < images->size(); ++i) {
    const auto stamp = std::llround(static_cast<double>(i) / config->rate_hz * 1e9);
    recording.frames.push_back({stamp, (*images)[i], {}, {}});
  }
  return recording;
}

}  // namespace cairn
