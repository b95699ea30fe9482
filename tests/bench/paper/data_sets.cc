#include "tests/bench/paper/data_sets.h"

#include <fmt/format.h>

#include "client/capture/synth_source.h"
#include "client/client_config.h"
#include "tests/integration/process.h"
#include "tests/support/dataset_writer.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::bench {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRpy = "tum_fr1_rpy_240";

fs::path config_folder() {
  return fs::path(CAIRN_SOURCE_DIR) / "config";
}

DataSet embedded(const std::string& name, const std::string& title, Role role,
                 const std::string& scene, const std::string& settings, int frames) {
  return {name, title, role, fmt::format("{}?frames={}{}", scene, frames, settings), {}};
}

// "rgbd_dataset_freiburg1_desk" or what people shorten it to.
std::optional<fs::path> find_sequence(const fs::path& data, const std::string& name) {
  for (const char* prefix : {"rgbd_dataset_freiburg1_", "freiburg1_", "fr1_", "tum_fr1_", ""})
    if (fs::is_regular_file(data / (prefix + name) / "rgb.txt")) return data / (prefix + name);
  return std::nullopt;
}

void add_recordings(const fs::path& data, std::vector<DataSet>& sets) {
  const auto add = [&](const char* name, const char* title, Role role) {
    if (const auto folder = find_sequence(data, name))
      sets.push_back({std::string("fr1_") + name, title, role, "", *folder});
  };
  add("desk", "TUM freiburg1 desk", Role::kOrdinary);
  add("360", "TUM freiburg1 360", Role::kHard);
  add("room", "TUM freiburg1 room", Role::kOrdinary);
}

}  // namespace

std::vector<DataSet> data_sets(const std::optional<fs::path>& data, bool quick) {
  const int frames = quick ? 120 : 240;
  std::vector<DataSet> sets = {
      embedded("desk", "office, looking at a desk", Role::kOrdinary, "desk", "", frames),
      embedded("weak", "weakly textured room", Role::kHard, "weak", "", frames),
      embedded("textureless", "textureless room", Role::kTextureless, "textureless", "", frames),
      embedded("turn", "office, once round on the spot, motion blur", Role::kHard, "turn", "",
               frames),
      embedded("weak_blur", "weakly textured room, motion blur", Role::kHard, "weak", "&blur=20",
               frames * 2 / 3)};
  if (const auto folder = testing::recording(kRpy))
    sets.push_back({"fr1_rpy", "TUM freiburg1 rpy, first 240 frames", Role::kHard, "", *folder});
  if (data) add_recordings(*data, sets);
  return sets;
}

Result<RunInput> run_input(const DataSet& set, int run) {
  RunInput input;
  if (set.synth.empty()) {
    input.source = "tum:" + set.folder.string();
    input.config = config_folder() / "client_tum_fr1.yaml";
    auto truth = read_trajectory((set.folder / "groundtruth.txt").string());
    if (!truth) return truth.error();
    input.truth = *truth;
    return input;
  }
  const auto options =
      parse_synth_spec(fmt::format("{}&seed={}&threads=2", set.synth, run), Sensor::kRgbd);
  if (!options) return options.error();
  const auto sequence = synthetic::SyntheticSequence::make(*options);
  if (!sequence) return sequence.error();
  input.rendered = std::make_shared<synthetic::TempFolder>();
  const fs::path folder = *input.rendered / "sequence";
  if (Status s = write_dataset(**sequence, folder, synthetic::DatasetLayout::kTum); !s)
    return s.error();
  input.source = "tum:" + folder.string();
  input.config = folder / "client.yaml";
  for (int i = 0; i < (*sequence)->size(); ++i)
    input.truth.push_back({(*sequence)->stamp_ns(i), (*sequence)->world_from_camera(i)});
  return input;
}

fs::path base_config() {
  return config_folder() / "client_synth.yaml";
}

Result<Camera> recording_camera() {
  const auto config = load_client_config((config_folder() / "client_tum_fr1.yaml").string());
  if (!config) return config.error();
  return config->camera->camera;
}

}  // namespace cairn::bench
