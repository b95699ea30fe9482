#include "server/tool/map_command.h"

#include <filesystem>
#include <map>
#include <memory>
#include <string>

#include <fmt/format.h>

#include "server/tool/map_export.h"
#if __has_include("server/storage/map_file.h")
#include "server/storage/map_file.h"
#endif

namespace cairn {
namespace {

struct Arguments {
  std::string file, out;
  MapFormat format = MapFormat::kTum;
};

const std::map<std::string, MapFormat> kFormats = {{"tum", MapFormat::kTum},
                                                   {"ply", MapFormat::kPly},
                                                   {"colmap", MapFormat::kColmap},
                                                   {"json", MapFormat::kJson}};

void print_info(const MapInfo& info) {
  std::cout << fmt::format("map          {:016x}, revision {}, {} merges and loops\n", info.id,
                           info.revision, info.merge_epoch);
  std::cout << fmt::format("keyframes    {}\n", info.keyframes);
  for (const MapInfo::Run& run : info.runs)
    std::cout << fmt::format("  run {:016x}: {} keyframes, {:.1f} s, {:.2f} m\n", run.epoch,
                             run.keyframes, run.duration_s, run.path_m);
  std::cout << fmt::format("landmarks    {}, seen {:.1f} times each\n", info.landmarks,
                           info.mean_observations);
  const Eigen::Vector3d size = info.box_max - info.box_min;
  std::cout << fmt::format("extent       {:.2f} x {:.2f} x {:.2f} m\n", size.x(), size.y(),
                           size.z());
  std::cout << fmt::format("reprojection {:.3f} px RMSE over {} observations\n",
                           info.reprojection_rmse, info.observations);
}

#if __has_include("server/storage/map_file.h")
int with_map(const std::string& path, const std::function<int(const Map&)>& use) {
  const auto map = load_map(path);
  return map ? use(*map) : fail(map.message());
}
#else
int with_map(const std::string& path, const std::function<int(const Map&)>&) {
  return fail(path + ": this build can't read map files");
}
#endif

std::string default_output(const Arguments& arguments) {
  for (const auto& [name, format] : kFormats)
    if (format == arguments.format)
      return std::filesystem::path(arguments.file).stem().string() +
             (format == MapFormat::kColmap ? "_colmap" : "." + name);
  return arguments.file;
}

int run_export(const Arguments& arguments) {
  const std::string out = arguments.out.empty() ? default_output(arguments) : arguments.out;
  return with_map(arguments.file, [&](const Map& map) {
    const Status status = export_map(map, arguments.format, out);
    if (!status) return fail(status.message());
    std::cout << out << '\n';
    return kExitOk;
  });
}

}  // namespace

void add_map_command(CLI::App& app, std::function<int()>& run) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("map", "Look into a saved map, or export it");
  command->require_subcommand(1);

  CLI::App* info = command->add_subcommand("info", "Print what the map holds");
  info->add_option("file", arguments->file, "Map file of cairn-server")->required();
  info->callback([arguments, &run] {
    run = [arguments] {
      return with_map(arguments->file, [](const Map& map) {
        print_info(info_of(map));
        return kExitOk;
      });
    };
  });

  CLI::App* exporter = command->add_subcommand("export", "Write the map in another format");
  exporter->add_option("file", arguments->file, "Map file of cairn-server")->required();
  exporter->add_option("--format", arguments->format, "tum (default), ply, colmap or json")
      ->transform(CLI::CheckedTransformer(kFormats, CLI::ignore_case).description(""));
  exporter->add_option("--out", arguments->out,
                       "File to write, or folder for colmap; default: named after the map file");
  exporter->callback([arguments, &run] { run = [arguments] { return run_export(*arguments); }; });
}

}  // namespace cairn
