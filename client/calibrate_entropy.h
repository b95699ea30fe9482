// The first pass of Luo et al. 2020: the mean entropy of a scene, found before it is tracked.
#pragma once

#include <cstdint>
#include <stop_token>
#include <string>

#include "client/client_config.h"
#include "common/util/status.h"

namespace cairn {

struct EntropyCalibration {
  std::uint64_t frames = 0;
  double scene_mean = 0;  // H_ave, bits: mean over the blocks of all images
  double threshold = 0;   // E0 that mode: calibrated makes of it, bits
};

// Reads all frames of `input` (see open_source()), or those until a stop. Errors: the source is
// unusable or without frames.
Result<EntropyCalibration> calibrate_entropy(const std::string& input, const ClientConfig& config,
                                             std::stop_token stop);

// The text of a client's YAML file with `mode: calibrated` and `scene_mean` in frontend: sharpen:,
// all else as it was, comments too. A `threshold`, which goes with another mode, becomes a comment.
// An error when these sections are written in braces.
Result<std::string> with_scene_mean(const std::string& yaml, double scene_mean);

// Changes the file so, at once or not at all, and only if it still loads.
Status store_scene_mean(const std::string& path, double scene_mean);

}  // namespace cairn
