#include "tests/bench/loops/known_map.h"

#include <algorithm>
#include <csignal>
#include <fstream>

#include <fmt/format.h>

#include "client/capture/synth_source.h"
#include "server/storage/map_file.h"
#include "tests/integration/process.h"

namespace cairn::bench {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;

std::string name_of(std::size_t walk) {
  return fmt::format("walker{}", walk);
}

// Nothing when no pose is within a fiftieth of a second.
std::optional<Rigid3> pose_at(const Trajectory& truth, std::int64_t stamp_ns) {
  const auto after = std::lower_bound(
      truth.begin(), truth.end(), stamp_ns,
      [](const StampedPose& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  const StampedPose* best = nullptr;
  for (const auto at : {after, after == truth.begin() ? after : after - 1})
    if (at != truth.end() &&
        (!best || std::abs(at->stamp_ns - stamp_ns) < std::abs(best->stamp_ns - stamp_ns)))
      best = &*at;
  if (!best || std::abs(best->stamp_ns - stamp_ns) > 20'000'000) return std::nullopt;
  return best->world_from_camera;
}

Result<KnownMap> load(const MapRun& run, const fs::path& path) {
  const auto file = MapFile::open(path, MapFile::Mode::kReadOnly);
  if (!file) return file.error();
  const auto clients = (*file)->clients();
  if (!clients) return clients.error();
  auto map = (*file)->load_map();
  if (!map) return map.error();
  if (!*map) return {ErrorCode::kNotFound, path.string() + ": no map in it"};
  KnownMap known{run.name, std::move(**map), {}, {}};
  for (const ClientId& client : *clients)
    for (std::size_t w = 0; w < run.walks.size(); ++w)
      if (client.name == name_of(w))
        known.map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
          if (id.epoch != client.epoch) return;
          if (const auto pose = pose_at(run.walks[w].truth, node.keyframe->stamp_ns))
            known.world_from_camera[id] = *pose;
        });
  return known;
}

// Frames of a list such as rgb.txt whose place is in [first, last).
Status copy_lines(const fs::path& from, const fs::path& to, std::size_t first, std::size_t last) {
  std::ifstream in(from);
  std::ofstream out(to);
  std::size_t number = 0;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    if (number >= first && number < last) out << line << '\n';
    ++number;
  }
  if (in.eof() && out.good()) return {};
  return {ErrorCode::kUnavailable, "can't copy " + from.string()};
}

}  // namespace

Result<WalkInput> synthetic_walk(const std::string& spec) {
  const auto options = parse_synth_spec(spec, Sensor::kRgbd);
  if (!options) return options.error();
  const auto sequence = synthetic::SyntheticSequence::make(*options);
  if (!sequence) return sequence.error();
  WalkInput walk{"synth:" + spec, fs::path(CAIRN_SOURCE_DIR) / "config/client_synth.yaml", {}};
  for (int i = 0; i < (*sequence)->size(); ++i)
    walk.truth.push_back({(*sequence)->stamp_ns(i), (*sequence)->world_from_camera(i)});
  return walk;
}

Result<WalkInput> recorded_walk(const std::string& recording, const std::string& config,
                                std::size_t first, std::size_t last, const fs::path& folder) {
  const auto source = testing::recording(recording);
  if (!source) return {ErrorCode::kNotFound, recording + " is not at hand"};
  const auto truth = read_trajectory((*source / "groundtruth.txt").string());
  if (!truth) return truth.error();
  fs::create_directories(folder);
  for (const char* images : {"rgb", "depth"})
    if (!fs::exists(folder / images))
      fs::create_directory_symlink(fs::absolute(*source / images), folder / images);
  if (Status s = copy_lines(*source / "rgb.txt", folder / "rgb.txt", first, last); !s)
    return s.error();
  if (Status s = copy_lines(*source / "depth.txt", folder / "depth.txt", 0, SIZE_MAX); !s)
    return s.error();
  return WalkInput{"tum:" + folder.string(), fs::path(CAIRN_SOURCE_DIR) / "config" / config,
                   *truth};
}

Result<KnownMap> make_known_map(const MapRun& run) {
  const fs::path kept = run.keep.empty() ? fs::path() : run.keep / (run.name + ".db");
  if (!kept.empty() && fs::exists(kept)) return load(run, kept);
  testing::Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  const std::string config = deployment.write(
      "server.yaml", fmt::format("log_level: debug\nloops:\n  close: {}\n", run.close_loops));
  const auto server = deployment.server({"--config", config, "--map", map});
  if (!server->wait_for_log("ready: ", seconds(20)))
    return {ErrorCode::kUnavailable, "cairn-server does not start: " + server->err()};
  for (std::size_t w = 0; w < run.walks.size(); ++w) {
    const auto client =
        deployment.client(name_of(w), run.walks[w].source, {"--lockstep", "--timeout", "300"},
                          run.walks[w].config.string());
    if (client->wait(seconds(1200)) != 0)
      return {ErrorCode::kUnavailable, "cairn-client fails: " + client->err()};
  }
  server->signal(SIGTERM);
  if (server->wait(seconds(60)) != 0)
    return {ErrorCode::kUnavailable, "cairn-server fails: " + server->err()};
  auto known = load(run, map);
  if (!known) return known;
  known->server_log = server->err();
  if (!kept.empty()) {
    fs::create_directories(run.keep);
    fs::copy_file(map, kept, fs::copy_options::overwrite_existing);
  }
  return known;
}

KnownMap side_by_side(const KnownMap& a, const KnownMap& b) {
  KnownMap both = a;
  both.name = a.name + " and " + b.name;
  // Landmarks that a server made are named by numbers that start anew in each map.
  const auto renamed = [&](LandmarkId id) {
    if (id.is_valid() && id.origin == LandmarkId::kServer) id.number += a.map.next_landmark;
    return id;
  };
  b.map.keyframes.for_each([&](KeyframeId id, KeyframeNode node) {
    for (LandmarkId& landmark : node.landmarks.edit()) landmark = renamed(landmark);
    both.map.keyframes.insert(id, std::move(node));
  });
  b.map.landmarks.for_each([&](LandmarkId id, Landmark landmark) {
    landmark.id = renamed(id);
    both.map.landmarks.insert(landmark.id, landmark);
  });
  const Rigid3 far_away{Eigen::Quaterniond::Identity(), {1000, 0, 0}};
  for (const auto& [id, pose] : b.world_from_camera) both.world_from_camera[id] = far_away * pose;
  return both;
}

}  // namespace cairn::bench
