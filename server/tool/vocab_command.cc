#include "server/tool/vocab_command.h"

#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <memory>

#include <fmt/format.h>

#include "server/place/vocabulary.h"
#include "server/place/vocabulary_training.h"
#include "server/tool/training_images.h"

namespace cairn {
namespace {

struct TrainArguments {
  std::vector<std::string> images, scenes;
  std::string out;
  int features = 1000, scene_frames = 30;
  std::uint64_t scene_seed = 9001;
  TrainingOptions training;
};

// A counter on a terminal; a line every hundred images in a pipe.
Progress show(const char* what) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  return [=](std::size_t done, std::size_t total) {
    if (terminal)
      std::cerr << fmt::format("\r{}: {}/{}{}", what, done, total, done == total ? "\n" : "");
    else if (done % 100 == 0 || done == total)
      std::cerr << fmt::format("{}: {}/{}\n", what, done, total);
  };
}

Result<ImageDescriptors> gather(const TrainArguments& arguments) {
  ImageDescriptors all;
  if (!arguments.images.empty()) {
    const auto files = images_in(arguments.images);
    if (!files) return files.error();
    auto described = describe_images(*files, arguments.features, show("images"));
    if (!described) return described.error();
    all = std::move(*described);
  }
  auto drawn = describe_scenes(arguments.scenes, arguments.scene_frames, arguments.scene_seed,
                               arguments.features, show("scenes"));
  if (!drawn) return drawn.error();
  all.insert(all.end(), std::make_move_iterator(drawn->begin()),
             std::make_move_iterator(drawn->end()));
  return all;
}

int run_train(const TrainArguments& arguments) {
  if (arguments.images.empty() && arguments.scenes.empty())
    return fail("vocab train: give --images or --scenes", kExitUsage);
  const auto images = gather(arguments);
  if (!images) return fail(images.message());
  const auto vocabulary = train_vocabulary(*images, arguments.training);
  if (!vocabulary) return fail("vocab train: " + vocabulary.message());
  if (const Status status = vocabulary->save(arguments.out); !status) return fail(status.message());
  std::cout << fmt::format("{}: {} words from {} images\n", arguments.out, vocabulary->size(),
                           images->size());
  return kExitOk;
}

int run_info(const std::string& path) {
  const auto start = std::chrono::steady_clock::now();
  const auto vocabulary = Vocabulary::load(path);
  const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
  if (!vocabulary) return fail(vocabulary.message());
  std::error_code ignored;
  const auto& weights = vocabulary->tree().weights;
  double sum = 0;
  for (const float weight : weights) sum += weight;
  std::cout << fmt::format(
      "version   {}\nwords     {}\ndepth     {}\nbranches  {}\nweight    {:.3f} mean\n"
      "checksum  {:016x}\nbytes     {}\nloads in  {:.1f} ms\n",
      Vocabulary::kVersion, vocabulary->size(), vocabulary->depth(), vocabulary->branches(),
      sum / static_cast<double>(weights.size()), vocabulary->checksum(),
      std::filesystem::file_size(path, ignored), took.count());
  return kExitOk;
}

void add_train(CLI::App& vocab, std::function<int()>& run) {
  auto arguments = std::make_shared<TrainArguments>();
  CLI::App* command = vocab.add_subcommand("train", "Make a vocabulary from images");
  command->add_option("--images", arguments->images, "Folders of images");
  command->add_option("--scenes", arguments->scenes, "Synthetic scenes, rendered for it");
  command->add_option("--out", arguments->out, "File to write")->required();
  auto& training = arguments->training;
  command->add_option("--words", training.words, "At most that many words")
      ->check(CLI::Range(16, 1'000'000))
      ->capture_default_str();
  command->add_option("--features", arguments->features, "Of each image, at most")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  command->add_option("--scene-frames", arguments->scene_frames, "Images of each scene")
      ->check(CLI::Range(1, 100'000))
      ->capture_default_str();
  command
      ->add_option("--scene-seed", arguments->scene_seed,
                   "Of the scenes; not one that results are reported on")
      ->capture_default_str();
  command->add_option("--branching", training.branching, "Clusters that a node is split into")
      ->check(CLI::Range(2, 255))
      ->capture_default_str();
  command->add_option("--seed", training.seed, "Of the training")->capture_default_str();
  command->callback([arguments, &run] { run = [arguments] { return run_train(*arguments); }; });
}

void add_info(CLI::App& vocab, std::function<int()>& run) {
  auto path = std::make_shared<std::string>();
  CLI::App* command = vocab.add_subcommand("info", "What a vocabulary file holds");
  command->add_option("FILE", *path, "Vocabulary")->required();
  command->callback([path, &run] { run = [path] { return run_info(*path); }; });
}

}  // namespace

void add_vocab_command(CLI::App& app, std::function<int()>& run) {
  CLI::App* vocab = app.add_subcommand("vocab", "Train and inspect vocabularies");
  vocab->require_subcommand(1);
  add_train(*vocab, run);
  add_info(*vocab, run);
}

}  // namespace cairn
