#include "tests/fuzz/targets.h"

#include <cstdlib>

#include "common/wire/envelope.h"
#include "common/wire/keyframe_codec.h"
#include "common/wire/map_update_codec.h"
#include "common/wire/relocalise_codec.h"

namespace cairn::fuzz {
namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

void check_keyframe_blob(wire::Bytes blob) {
  const auto first = wire::decode_keyframe(blob);
  if (!first) return;
  require(wire::check_keyframe(*first->keyframe).ok());
  const auto again = wire::encode_keyframe(first->client.name, *first->keyframe);
  require(again.ok());
  const auto second = wire::decode_keyframe(*again);
  require(second.ok() && second->client == first->client &&
          second->keyframe->matches == first->keyframe->matches &&
          second->keyframe->features.descriptors == first->keyframe->features.descriptors);
}

void check_map_update_blob(wire::Bytes blob) {
  const auto first = wire::decode_map_update(blob);
  if (!first) return;
  require(wire::check_map_update(first->update).ok());
  const auto again = wire::encode_map_update(first->client, first->update);
  require(again.ok() && wire::decode_map_update(*again).ok());
}

void check_answer_blob(wire::Bytes blob) {
  const auto first = wire::decode_answer(blob);
  if (!first) return;
  require(wire::check_answer(first->answer).ok());
  const auto again = wire::encode_answer(first->client, first->answer);
  require(again.ok() && wire::decode_answer(*again).ok());
}

}  // namespace

// As they are, and as the payload under a good checksum, which gets behind the outer checks.
void keyframe(const std::uint8_t* data, std::size_t size) {
  check_keyframe_blob({data, size});
  check_keyframe_blob(wire::seal(wire::kKeyframeFormat, {data, size}));
}

void map_update(const std::uint8_t* data, std::size_t size) {
  check_map_update_blob({data, size});
  check_map_update_blob(wire::seal(wire::kMapUpdateFormat, {data, size}));
}

void answer(const std::uint8_t* data, std::size_t size) {
  check_answer_blob({data, size});
  check_answer_blob(wire::seal(wire::kRelocaliseFormat, {data, size}));
}

}  // namespace cairn::fuzz
