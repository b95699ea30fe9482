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
  bool json = false;
  std::size_t event = 0;
};

const std::map<std::string, MapFormat> kFormats = {{"tum", MapFormat::kTum},
                                                   {"ply", MapFormat::kPly},
                                                   {"colmap", MapFormat::kColmap},
                                                   {"json", MapFormat::kJson}};

void print_loops(const MapInfo& info) {
  const auto name = [&](KeyframeId id) {
    return fmt::format("{} {}", info.client_of(id.epoch), id.sequence);
  };
  std::cout << fmt::format("events       {} merges and loops\n", info.loops.size());
  for (std::size_t i = 0; i < info.loops.size(); ++i) {
    const MapInfo::Loop& loop = info.loops[i];
    std::cout << fmt::format("  {:>3} {:<5}    keyframe {} to {}, {} inliers{}\n", i + 1,
                             loop.merges ? "merge" : "loop", name(loop.query), name(loop.candidate),
                             loop.inliers, loop.can_undo.value_or(false) ? ", can be undone" : "");
  }
}

void print_info(const MapInfo& info, MapFile& file) {
  std::cout << fmt::format("map          {:016x}, revision {}\n", info.id, info.revision);
  std::cout << fmt::format("keyframes    {}\n", info.keyframes);
  for (const MapInfo::Run& run : info.runs)
    std::cout << fmt::format(
        "  {:<12} run {:016x}: {} keyframes of {} received, {:.1f} s, {:.2f} m\n",
        info.client_of(run.epoch), run.epoch, run.keyframes,
        file.next_sequence({run.client, run.epoch}), run.duration_s, run.path_m);
  std::cout << fmt::format("landmarks    {}, seen {:.1f} times each\n", info.landmarks,
                           info.mean_observations);
  const Eigen::Vector3d size = info.box_max - info.box_min;
  std::cout << fmt::format("extent       {:.2f} x {:.2f} x {:.2f} m\n", size.x(), size.y(),
                           size.z());
  std::cout << fmt::format("reprojection {:.3f} px RMSE over {} observations\n",
                           info.reprojection_rmse, info.observations);
  print_loops(info);
}

// With what the file knows besides the map: names of clients, and what can be undone.
MapInfo info_of(const Map& map, MapFile& file) {
  MapInfo info = info_of(map);
  const auto clients = file.clients();
  if (clients)
    for (MapInfo::Run& run : info.runs)
      for (const ClientId& client : *clients)
        if (client.epoch == run.epoch) run.client = client.name;
  const auto events = file.checkpoints();
  for (std::size_t i = 0; i < info.loops.size(); ++i)
    info.loops[i].can_undo =
        events.ok() && std::find(events->begin(), events->end(), i + 1) != events->end();
  return info;
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
  const MapInfo info = info_of(*map, **file);
  if (arguments.json)
    write_info_json(info, std::cout);
  else
    print_info(info, **file);
  return kExitOk;
}

int run_undo(const Arguments& arguments) {
  // Opening to write would make a new file.
  std::error_code ignored;
  if (!std::filesystem::exists(arguments.file, ignored))
    return fail(arguments.file + ": no such file");
  const auto file = MapFile::open(arguments.file);
  if (!file) return fail(file.message());
  if (const Status status = (*file)->restore(arguments.event); !status)
    return fail(arguments.file + ": " + status.message());
  const auto map = load_map(**file, arguments.file);
  if (!map) return fail(map.message());
  const auto pending = (*file)->pending_keyframes();
  if (!pending) return fail(pending.message());
  std::cout << fmt::format(
      "the map is as it was before event {}: {} keyframes, {} landmarks; cairn-server will map {} "
      "later keyframes again\n",
      arguments.event, map->keyframes.size(), map->landmarks.size(), pending->size());
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
  const Status status = export_map(*map, info_of(*map, **file), arguments.format, out);
  if (!status) return fail(status.message());
  std::cout << out << '\n';
  return kExitOk;
}

}  // namespace

void add_map_command(CLI::App& app, std::function<int()>& run) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("map", "Look into a saved map, export it, undo loops");
  command->require_subcommand(1);

  CLI::App* info = command->add_subcommand("info", "Print what the map holds");
  info->add_option("file", arguments->file, "Map file of cairn-server")->required();
  info->add_flag("--json", arguments->json, "Print JSON");
  info->callback([arguments, &run] { run = [arguments] { return run_info(*arguments); }; });

  CLI::App* exporter = command->add_subcommand("export", "Write the map in another format");
  exporter->add_option("file", arguments->file, "Map file of cairn-server")->required();
  exporter->add_option("--format", arguments->format, "tum (default), ply, colmap or json")
      ->transform(CLI::CheckedTransformer(kFormats, CLI::ignore_case).description(""));
  exporter->add_option("--out", arguments->out,
                       "File to write, or folder for colmap; default: named after the map file");
  exporter->callback([arguments, &run] { run = [arguments] { return run_export(*arguments); }; });

  CLI::App* undo = command->add_subcommand(
      "undo", "Go back to before a loop or merge; the server must not be running");
  undo->add_option("file", arguments->file, "Map file of cairn-server")->required();
  undo->add_option("event", arguments->event, "Number of the event, as `cairn map info` counts")
      ->required()
      ->check(CLI::PositiveNumber);
  undo->callback([arguments, &run] { run = [arguments] { return run_undo(*arguments); }; });
}

}  // namespace cairn
