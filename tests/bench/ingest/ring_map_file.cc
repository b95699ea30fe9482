#include "tests/bench/ingest/ring_map_file.h"

#include "common/wire/keyframe_codec.h"
#include "server/storage/map_file.h"

namespace cairn::bench {

Status write_ring_map(const RingWorldOptions& options, const std::filesystem::path& path) {
  RingWorld world(options);
  Map& map = world.map;
  map.id = {1};
  map.keyframes_ever = static_cast<std::uint64_t>(options.keyframes);
  map.next_landmark = static_cast<std::uint64_t>(options.landmarks) + 1;
  map.mapped_keyframes.insert(kRingClient.epoch, static_cast<std::uint32_t>(options.keyframes));
  // A map with a loop is adjusted as a whole when one of its clients has finished.
  LoopEdge& loop = map.loops.emplace_back();
  loop.query = RingWorld::id(options.keyframes - 1);
  loop.candidate = RingWorld::id(0);
  loop.candidate_from_query = Sim3(world.truth.front().inverse() * world.truth.back());
  loop.inliers = 100;

  auto file = MapFile::open(path);
  if (!file) return file.error();
  for (const KeyframeId id : map.keyframes.sorted_keys()) {
    const auto blob = wire::encode_keyframe(kRingClient.name, *map.keyframes.at(id).keyframe);
    if (!blob) return blob.error();
    if (Status s = (*file)->append(kRingClient, id, *blob); !s) return s;
  }
  const auto saved = (*file)->save_map(map);
  return saved ? Status() : Status(saved.error());
}

}  // namespace cairn::bench
