// Who is found where: views of a synthetic walk held against a saved map of the same scene.
//
//   cairn-server --map hall.db ... ; cairn-client --input 'synth:hall?frames=300&start=30' ...
//   ./dev bench relocalise --map hall.db --origin 'hall?start=30' --views 'hall?path=1'
#include <algorithm>
#include <cstdio>
#include <string>

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "client/capture/synth_source.h"
#include "client/frontend/frontend.h"
#include "common/config/camera_config.h"
#include "server/place/default_vocabulary.h"
#include "server/relocaliser.h"
#include "server/storage/map_file.h"

namespace cairn::bench {
namespace {

// Found, but farther from the truth than this: metres and radians. The map has errors of its own.
constexpr double kWrongShift = 0.15, kWrongTurn = 0.05;

struct Request {
  std::string map_file, origin, views;
  int every = 10;
};

struct Prepared {
  Map map;
  Vocabulary vocabulary;
  Rigid3 map_from_world;
  std::shared_ptr<const synthetic::SyntheticSequence> views;
};

Result<std::shared_ptr<const synthetic::SyntheticSequence>> sequence(const std::string& spec) {
  const auto options = parse_synth_spec(spec, Sensor::kRgbd);
  if (!options) return options.error();
  return synthetic::SyntheticSequence::make(*options);
}

Result<Prepared> prepare(const Request& request) {
  auto vocabulary = default_vocabulary();
  if (!vocabulary) return vocabulary.error();
  auto file = MapFile::open(request.map_file);
  if (!file) return file.error();
  auto map = (*file)->load_map();
  if (!map) return map.error();
  if (!*map) return Error{ErrorCode::kNotFound, request.map_file + ": holds no map"};
  const auto origin = sequence(request.origin);
  if (!origin) return origin.error();
  const auto views = sequence(request.views);
  if (!views) return views.error();
  Prepared p{.map = std::move(**map),
             .vocabulary = std::move(*vocabulary),
             .map_from_world = (*origin)->world_from_camera(0).inverse(),
             .views = *views};
  return p;
}

int run(const Request& request) {
  auto prepared = prepare(request);
  if (!prepared) {
    fmt::print(stderr, "relocalise: {}\n", prepared.message());
    return 1;
  }
  Prepared& p = *prepared;
  PlaceIndex index;
  p.map.keyframes.for_each([&](KeyframeId id, const KeyframeNode& node) {
    index.add(id, p.vocabulary.words(node.features().descriptors));
  });
  CameraConfig camera;
  camera.sensor = p.views->options().sensor;
  camera.camera = p.views->camera();
  camera.rate_hz = p.views->options().rate_hz;
  Frontend frontend(camera, {});
  const auto rig = std::make_shared<const Rig>(frontend.rig());
  int asked = 0, right = 0, wrong = 0;
  for (int i = 0; i < p.views->size(); i += request.every) {
    const auto frame = p.views->frame(i);
    Keyframe view;
    view.id = {1, static_cast<std::uint32_t>(i)};
    view.rig = rig;
    view.features =
        frontend.process({frame.stamp_ns, frame.gray, frame.right, frame.depth}).features;
    const RelocaliseAnswer answer = relocalise(p.map, index, p.vocabulary, view, {});
    ++asked;
    if (!answer.found) continue;
    const Rigid3 error =
        (p.map_from_world * frame.world_from_camera).inverse() * answer.map_from_camera;
    const bool is_right =
        error.translation.norm() < kWrongShift && rotation_angle(error) < kWrongTurn;
    ++(is_right ? right : wrong);
    if (!is_right)
      fmt::print("frame {}: {} landmarks, off by {:.2f} m and {:.2f} rad\n", i,
                 answer.matches.size(), error.translation.norm(), rotation_angle(error));
  }
  fmt::print("{} against {} keyframes: {} views, {} found, {} wrongly\n", request.views,
             p.map.keyframes.size(), asked, right, wrong);
  return 0;
}

}  // namespace
}  // namespace cairn::bench

int main(int argc, char** argv) {
  CLI::App app("Relocalisation: views of a synthetic walk in a saved map",
               "cairn_relocalise_bench");
  cairn::bench::Request request;
  app.add_option("--map", request.map_file, "Map file of a client in a synthetic scene")
      ->required();
  app.add_option("--origin", request.origin, "SCENE?key=value... that this client has played")
      ->required();
  app.add_option("--views", request.views, "SCENE?key=value... of what is looked for")->required();
  app.add_option("--every", request.every, "Of its frames, each so-manyth")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return cairn::bench::run(request);
}
