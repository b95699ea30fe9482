// What the paper's experiments are repeated on: scenes of the embedded world that stand for the
// paper's recordings, and the recordings themselves where they are at hand.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/camera.h"
#include "common/model/trajectory.h"
#include "common/util/status.h"
#include "tests/support/temp_folder.h"

namespace cairn::bench {

// What is expected of sharpening on it.
enum class Role {
  kOrdinary,     // not to be made worse
  kHard,         // blurred or weakly textured: to become better
  kTextureless,  // without sharpening hardly to be tracked at all
};

struct DataSet {
  std::string name;   // short, without blanks: of files
  std::string title;  // what it is
  Role role = Role::kOrdinary;
  std::string synth;             // SCENE?key=value..., less the seed; empty: a recording
  std::filesystem::path folder;  // TUM layout with groundtruth.txt
};

// The embedded scenes; rpy where `shared` ($CAIRN_DATA) holds it; desk, 360 and room where `data`
// does, under the benchmark's names. `quick`: short.
std::vector<DataSet> data_sets(const std::optional<std::filesystem::path>& data, bool quick);

// The n-th run, from 1. In the embedded world each has a seed of its own, of textures, noise and
// the hand's shake; runs on a recording differ only in what the server's answers meet.
struct RunInput {
  std::string source;            // for cairn-client --input
  std::filesystem::path config;  // for cairn-client --config, before sharpening is set in it
  Trajectory truth;
  // Holds a rendered sequence: drawn once, played to every variant.
  std::shared_ptr<synthetic::TempFolder> rendered;
};
Result<RunInput> run_input(const DataSet& set, int run);

// A config without a camera, for what does not depend on the data set.
std::filesystem::path base_config();
// The camera of the recordings.
Result<Camera> recording_camera();

}  // namespace cairn::bench
