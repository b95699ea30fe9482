// The fuzz targets on a fixed number of mutations of good blobs, the same in each run, so that they
// run wherever the tests do. For the open-ended search build with clang and -DCAIRN_FUZZ=ON.
#include <gtest/gtest.h>

#include <functional>
#include <random>

#include "common/wire/envelope.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/map_update_codec.h"
#include "common/wire/relocalise_codec.h"
#include "tests/fuzz/targets.h"
#include "tests/support/wire_samples.h"

namespace cairn {
namespace {

using wire::Blob;

// A few changes of the kinds that break decoders: flipped bits, extreme bytes, bytes taken out, put
// in, or repeated, and the end cut off.
Blob mutate(Blob bytes, std::mt19937_64& random) {
  static constexpr std::uint8_t kExtremes[] = {0, 1, 0x7f, 0x80, 0xfe, 0xff};
  const auto changes = 1 + random() % 4;
  for (std::uint64_t i = 0; i < changes && !bytes.empty(); ++i) {
    const auto at = static_cast<std::ptrdiff_t>(random() % bytes.size());
    const auto place = bytes.begin() + at;
    switch (random() % 6) {
      case 0:
        *place ^= static_cast<std::uint8_t>(1u << (random() % 8));
        break;
      case 1:
        *place = kExtremes[random() % std::size(kExtremes)];
        break;
      case 2:
        bytes.erase(place);
        break;
      case 3:
        bytes.insert(place, static_cast<std::uint8_t>(random()));
        break;
      case 4: {
        const Blob piece(place, place + std::min<std::ptrdiff_t>(16, bytes.end() - place));
        bytes.insert(place, piece.begin(), piece.end());
        break;
      }
      default:
        bytes.resize(static_cast<std::size_t>(at));
    }
  }
  return bytes;
}

void run(const std::vector<Blob>& seeds, void (*target)(const std::uint8_t*, std::size_t)) {
  std::mt19937_64 random(2024);
  for (int i = 0; i < 20'000; ++i) {
    const Blob& seed = seeds[random() % seeds.size()];
    // Half of them without the envelope: the target puts a good one around.
    Blob start = random() % 2 ? seed : Blob(seed.begin() + wire::kEnvelopeSize, seed.end());
    const Blob bytes = mutate(std::move(start), random);
    target(bytes.data(), bytes.size());
  }
}

TEST(Fuzz, NoMutationOfAKeyframeBreaksItsDecoder) {
  run({*wire::encode_keyframe("alice", testing::sample_keyframe({7, 0}, 0)),
       *wire::encode_keyframe("alice", testing::sample_keyframe({7, 3}, 4)),
       *wire::encode_keyframe("b", testing::sample_keyframe({~0ull, 70'000}, 20))},
      fuzz::keyframe);
}

TEST(Fuzz, NoMutationOfAMapUpdateBreaksItsDecoder) {
  MapUpdate empty;
  empty.map = {1};
  empty.epoch = empty.revision = 1;
  run({*wire::encode_map_update("alice", empty),
       *wire::encode_map_update("alice", testing::sample_update(7, 3)),
       *wire::encode_map_update("b", testing::sample_update(~1ull, 20))},
      fuzz::map_update);
}

TEST(Fuzz, NoMutationOfAnAnswerBreaksItsDecoder) {
  RelocaliseAnswer nowhere;
  nowhere.epoch = 1;
  nowhere.why = "nothing looks like it";
  run({*wire::encode_answer("alice", nowhere),
       *wire::encode_answer("alice", testing::sample_answer(7, 3)),
       *wire::encode_answer("b", testing::sample_answer(~1ull, 20))},
      fuzz::answer);
}

}  // namespace
}  // namespace cairn
