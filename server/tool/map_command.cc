#include "server/tool/map_command.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "server/storage/map_file.h"
#include "server/tool/map_export.h"

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

void print_info(const MapInfo& info, const std::vector<ClientId>& clients, MapFile& file) {
  std::cout << fmt::format("map          {:016x}, revision {}, {} merges and loops\n", info.id,
                           info.revision, info.merge_epoch);
  std::cout << fmt::format("keyframes    {}\n", info.keyframes);
  for (const MapInfo::Run& run : info.runs) {
    const auto client = std::find_if(clients.begin(), clients.end(),
                                     [&](const ClientId& c) { return c.epoch == run.epoch; });
    const bool known = client != clients.end();
    std::cout << fmt::format(
        "  {:<12} run {:016x}: {} keyframes of {} received, {:.1f} s, {:.2f} m\n",
        known ? client->name : "?", run.epoch, run.keyframes,
        known ? file.next_sequence(*client) : 0, run.duration_s, run.path_m);
  }
  std::cout << fmt::format("landmarks    {}, seen {:.1f} times each\n", info.landmarks,
                           info.mean_observations);
  const Eigen::Vector3d size = info.box_max - info.box_min;
  std::cout << fmt::format("extent       {:.2f} x {:.2f} x {:.2f} m\n", size.x(), size.y(),
                           size.z());
  std::cout << fmt::format("reprojection {:.3f} px RMSE over {} observations\n",
                           info.reprojection_rmse, info.observations);
}

Result<Map> load_map(MapFile& file, const std::string& path) {
  auto map = file.load_map();
  if (!map) return map.error();
  if (!map->has_value())
    return Error{ErrorCode::kNotFound, path + ": holds keyframes but no saved map yet"};
  return std::move(**map);
}

int run_info(const Arguments& arguments) {
  const auto file = MapFile::open(arguments.file, MapFile::Mode::kReadOnly);
  if (!file) return fail(file.message());
  const auto map = load_map(**file, arguments.file);
  if (!map) return fail(map.message());
  const auto clients = (*file)->clients();
  print_info(info_of(*map), clients ? *clients : std::vector<ClientId>{}, **file);
  return kExitOk;
}

std::string default_output(const Arguments& arguments) {
  for (const auto& [name, format] : kFormats)
    if (format == arguments.format)
      return std::filesystem::path(arguments.file).stem().string() +
             (format == MapFormat::kColmap ? "_colmap" : "." + name);
  return arguments.file;
}

int run_export(const Arguments& arguments) {
  const auto file = MapFile::open(arguments.file, MapFile::Mode::kReadOnly);
  if (!file) return fail(file.message());
  const auto map = load_map(**file, arguments.file);
  if (!map) return fail(map.message());
  const std::string out = arguments.out.empty() ? default_output(arguments) : arguments.out;
  const Status status = export_map(*map, arguments.format, out);
  if (!status) return fail(status.message());
  std::cout << out << '\n';
  return kExitOk;
}

}  // namespace

void add_map_command(CLI::App& app, std::function<int()>& run) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("map", "Look into a saved map, or export it");
  command->require_subcommand(1);

  CLI::App* info = command->add_subcommand("info", "Print what the map holds");
  info->add_option("file", arguments->file, "Map file of cairn-server")->required();
  info->callback([arguments, &run] { run = [arguments] { return run_info(*arguments); }; });

  CLI::App* exporter = command->add_subcommand("export", "Write the map in another format");
  exporter->add_option("file", arguments->file, "Map file of cairn-server")->required();
  exporter->add_option("--format", arguments->format, "tum (default), ply, colmap or json")
      ->transform(CLI::CheckedTransformer(kFormats, CLI::ignore_case).description(""));
  exporter->add_option("--out", arguments->out,
                       "File to write, or folder for colmap; default: named after the map file");
  exporter->callback([arguments, &run] { run = [arguments] { return run_export(*arguments); }; });
}

}  // namespace cairn
