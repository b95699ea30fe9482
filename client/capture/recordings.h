// Recordings on disk: what their folders hold, by layout.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "client/capture/image_list.h"
#include "common/config/camera_config.h"
#include "common/util/status.h"

namespace cairn {

struct Recording {
  CameraConfig camera;  // of the files; pairs may still be raw (camera.right set)
  std::vector<FrameFiles> frames;
};

// All of them: `config` is the user's camera. Errors are one line that says what is missing.

// rgb.txt with depth.txt (RGB-D) or right.txt (stereo). Images of different cameras belong together
// when they are at most 20 ms apart. Needs a config.
Result<Recording> read_tum(const std::filesystem::path& folder,
                           const std::optional<CameraConfig>& config);
// mav0/cam0 and, for stereo, mav0/cam1. Without config the calibration comes from their
// sensor.yaml, stereo when there is a cam1.
Result<Recording> read_euroc(const std::filesystem::path& folder,
                             const std::optional<CameraConfig>& config);
// image_0, image_1, times.txt; without config, calib.txt (P0, P1): rectified stereo, or mono when
// image_1 is absent.
Result<Recording> read_kitti(const std::filesystem::path& folder,
                             const std::optional<CameraConfig>& config);
// The images of a folder by name, at the config's rate. Mono; needs a config.
Result<Recording> read_folder(const std::filesystem::path& folder,
                              const std::optional<CameraConfig>& config);

// What all sources say when they need a camera and have none.
Error camera_missing(const std::string& source);

}  // namespace cairn
