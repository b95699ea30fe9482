#include "server/tool/synth_command.h"

#include <unistd.h>

#include <algorithm>
#include <memory>
#include <string>
#include <thread>

#include <fmt/format.h>

#include "tests/support/dataset_writer.h"

namespace cairn {
namespace {

struct Arguments {
  synthetic::SequenceOptions sequence;
  std::string out;
  bool stereo = false, mono = false, euroc = false, blur = false, no_noise = false;
  bool poses_only = false;
};

std::string scenes_text() {
  std::string text = "Scenes:";
  for (const auto& scene : synthetic::scene_list()) {
    text += fmt::format("\n  {:<12} {}", scene.name, scene.description);
  }
  return text;
}

// A counter on a terminal; a line every hundred frames in a pipe.
bool show_progress(int written, int total) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  if (terminal) {
    std::cerr << fmt::format("\r{}/{} frames{}", written, total, written == total ? "\n" : "");
  } else if (written % 100 == 0 || written == total) {
    std::cerr << fmt::format("{}/{} frames\n", written, total);
  }
  return true;
}

int run_synth(const Arguments& arguments) {
  synthetic::SequenceOptions options = arguments.sequence;
  if (arguments.stereo) options.sensor = Sensor::kStereo;
  if (arguments.mono) options.sensor = Sensor::kMono;
  if (arguments.blur) options.exposure_s = 0.020;
  if (arguments.no_noise) options.noise = options.depth_noise = false;
  options.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1u, 4u));
  const auto sequence = synthetic::SyntheticSequence::make(options);
  if (!sequence) return fail(sequence.message(), kExitUsage);
  if (arguments.poses_only) {
    const Status status = synthetic::write_ground_truth(**sequence, arguments.out);
    if (!status) return fail(status.message());
    std::cout << arguments.out << '\n';
    return kExitOk;
  }
  const auto layout =
      arguments.euroc ? synthetic::DatasetLayout::kEuroc : synthetic::DatasetLayout::kTum;
  const int total = (*sequence)->size();
  const Status status =
      synthetic::write_dataset(**sequence, arguments.out, layout,
                               [&](int written) { return show_progress(written, total); });
  if (!status) {
    const bool usage = status.error().code == ErrorCode::kInvalidArgument;
    return fail(status.message(), usage ? kExitUsage : kExitFailure);
  }
  std::cout << arguments.out << '\n';
  return kExitOk;
}

}  // namespace

void add_synth_command(CLI::App& app, std::function<int()>& run) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("synth", "Render a synthetic scene into a recording with ground truth");
  command->footer(scenes_text());
  auto& sequence = arguments->sequence;
  command->add_option("--scene", sequence.scene, "Which scene (listed below)")->required();
  command
      ->add_option("--out", arguments->out,
                   "Folder to write; new or empty (with --poses-only: file)")
      ->required();
  command->add_option("--frames", sequence.frames, "How many frames; 0: once round the path");
  command->add_option("--path", sequence.path, "Which way through the scene: 0, 1, 2, ...");
  command->add_option("--seed", sequence.seed, "Of textures and noise")->capture_default_str();
  command->add_option("--rate", sequence.rate_hz, "Frames a second")->capture_default_str();
  auto* stereo = command->add_flag("--stereo", arguments->stereo, "Stereo pairs; default: RGB-D");
  command->add_flag("--mono", arguments->mono, "Single images")->excludes(stereo);
  command->add_flag("--blur", arguments->blur, "Motion blur, as of a shutter of 20 ms");
  command->add_flag("--no-noise", arguments->no_noise, "A perfect sensor");
  command->add_flag("--euroc", arguments->euroc,
                    "EuRoC layout (with --stereo or --mono); default: TUM layout");
  command->add_flag("--poses-only", arguments->poses_only,
                    "Ground truth alone, in TUM format, for sequences played with synth:");
  command->callback([arguments, &run] { run = [arguments] { return run_synth(*arguments); }; });
}

}  // namespace cairn
