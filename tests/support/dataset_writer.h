// Writes a synthetic sequence as a recording in the layouts that `cairn-client` reads.
#pragma once

#include <filesystem>
#include <functional>

#include "common/util/status.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::synthetic {

enum class DatasetLayout { kTum, kEuroc };

// Called after each frame with the number of frames written; false stops the writing.
using WriteProgress = std::function<bool(int written)>;

// Into `folder`, which is made when needed and must be empty.
//   kTum:   rgb/ with rgb.txt, depth/ with depth.txt (RGB-D, 16 bits, 5000 a metre) or right/ with
//           right.txt (stereo), groundtruth.txt, and client.yaml with the camera
//   kEuroc: mav0/cam0 (and cam1) with data.csv and sensor.yaml, mav0/state_groundtruth_estimate0,
//           groundtruth.txt; stereo or mono only
// groundtruth.txt is world_from_camera in TUM format: seconds tx ty tz qx qy qz qw. Errors name the
// file that could not be written.
Status write_dataset(const SyntheticSequence& sequence, const std::filesystem::path& folder,
                     DatasetLayout layout, const WriteProgress& progress = {});

// groundtruth.txt alone, as `file`, for sequences that are rendered while they play.
Status write_ground_truth(const SyntheticSequence& sequence, const std::filesystem::path& file);

// The text of a client config for this camera, complete (sensor and camera keys).
std::string client_config_text(const SyntheticSequence& sequence);

}  // namespace cairn::synthetic
