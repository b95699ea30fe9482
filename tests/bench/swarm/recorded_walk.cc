#include "tests/bench/swarm/recorded_walk.h"

#include <fstream>

#include <fmt/format.h>

#include "client/link/outbox.h"
#include "common/wire/keyframe_codec.h"
#include "tests/integration/process.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::bench {
namespace {

namespace fs = std::filesystem;

// Without a server the keyframes of a run stay in the outbox.
Status run_client(const WalkOptions& options, const std::string& name, const fs::path& outbox) {
  const fs::path config = options.folder / "client.yaml";
  std::ofstream(config) << "tracking:\n  keyframe_min_shared: " << options.min_shared << "\n";
  const fs::path unfinished = outbox.string() + ".unfinished";
  fs::remove(unfinished);
  testing::Process client(
      std::string(CAIRN_BINARY_DIR) + "/cairn-client",
      {"--config", config, "--name", name, "--outbox", unfinished, "--no-server", "--max-rate",
       "--input",
       fmt::format("synth:{}?path={}&frames={}", options.scene, options.path, options.frames)},
      {}, options.folder / name);
  constexpr int kDeliveredNothing = 3;
  if (client.wait(std::chrono::seconds(600)) != kDeliveredNothing)
    return {ErrorCode::kInternal, "cairn-client could not record " + name + ": " + client.err()};
  std::error_code error;
  fs::rename(unfinished, outbox, error);
  if (error) return {ErrorCode::kUnavailable, outbox.string() + ": " + error.message()};
  return {};
}

Result<std::vector<KeyframePtr>> read_outbox(const fs::path& path, const std::string& name) {
  Result<std::unique_ptr<Outbox>> outbox = Outbox::open(path, name);
  if (!outbox) return outbox.error();
  std::vector<KeyframePtr> keyframes;
  for (const KeyframeId id : (*outbox)->waiting()) {
    const Result<wire::Blob> blob = (*outbox)->get(id);
    if (!blob) return blob.error();
    Result<wire::DecodedKeyframe> decoded = wire::decode_keyframe(*blob);
    if (!decoded) return decoded.error();
    keyframes.push_back(std::move(decoded->keyframe));
  }
  return keyframes;
}

Result<Trajectory> truth_of(const WalkOptions& options) {
  const auto sequence = synthetic::SyntheticSequence::make(
      {.scene = options.scene, .path = options.path, .frames = options.frames});
  if (!sequence) return sequence.error();
  Trajectory truth;
  for (int i = 0; i < (*sequence)->size(); ++i)
    truth.push_back({(*sequence)->stamp_ns(i), (*sequence)->world_from_camera(i)});
  return truth;
}

Result<RecordedWalk> record_walk(const WalkOptions& options) {
  RecordedWalk walk;
  walk.name = fmt::format("{}{}", options.scene, options.path);
  const fs::path outbox = options.folder / fmt::format("{}-{}-{}.outbox", walk.name, options.frames,
                                                       options.min_shared);
  fs::create_directories(options.folder);
  Result<std::vector<KeyframePtr>> keyframes{ErrorCode::kNotFound, "not recorded yet"};
  if (fs::exists(outbox)) keyframes = read_outbox(outbox, walk.name);
  const bool of_this_version = keyframes || keyframes.error().code != ErrorCode::kVersion;
  if (!fs::exists(outbox) || !of_this_version) {
    fs::remove(outbox);
    if (Status s = run_client(options, walk.name, outbox); !s) return s.error();
    keyframes = read_outbox(outbox, walk.name);
  }
  if (!keyframes) return keyframes.error();
  walk.keyframes = std::move(*keyframes);
  Result<Trajectory> truth = truth_of(options);
  if (!truth) return truth.error();
  walk.truth = std::move(*truth);
  return walk;
}

}  // namespace

Result<std::vector<RecordedWalk>> record_walks(const WalkOptions& options, int count,
                                               const std::string& program) {
  std::vector<RecordedWalk> walks;
  for (int i = 0; i < count; ++i) {
    fmt::print(stderr, "{}: recording walk {} of {}\n", program, i + 1, count);
    WalkOptions one = options;
    one.path += i;
    Result<RecordedWalk> walk = record_walk(one);
    if (!walk) return walk.error();
    walks.push_back(std::move(*walk));
  }
  return walks;
}

RecordedWalk as_new_run(const RecordedWalk& walk, const std::string& name, std::uint64_t epoch) {
  RecordedWalk run{name, {}, walk.truth};
  for (const KeyframePtr& recorded : walk.keyframes) {
    Keyframe keyframe = *recorded;
    const std::uint64_t former = keyframe.id.epoch;
    keyframe.id.epoch = epoch;
    if (keyframe.reference.is_valid()) keyframe.reference.epoch = epoch;
    for (LandmarkMatch& match : keyframe.matches)
      if (match.landmark.origin == former) match.landmark.origin = epoch;
    run.keyframes.push_back(std::make_shared<const Keyframe>(std::move(keyframe)));
  }
  return run;
}

}  // namespace cairn::bench
