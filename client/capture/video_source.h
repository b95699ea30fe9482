// Frames through OpenCV's video input: files and cameras of the operating system. Mono.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "client/capture/frame_source.h"

namespace cairn {

// Stamps count from 0 at the file's own rate (the config's where the file doesn't know).
Result<std::unique_ptr<FrameSource>> open_video(const std::string& file,
                                                const std::optional<CameraConfig>& config);
// Camera `number` as the system counts them. Stamps are the system's clock when the image arrived.
Result<std::unique_ptr<FrameSource>> open_camera(const std::string& number,
                                                 const std::optional<CameraConfig>& config);

}  // namespace cairn
