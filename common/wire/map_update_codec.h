// A map update as bytes. Most of it is landmarks, so these are small: one that only moved takes 8
// bytes, one that is new about 22, or 51 when the client has not seen itself what it looks like.
//
//   id          ascending, by the distance from the one before; 1 or 2 bytes
//   position    6 bytes, rounded to a share of its distance from MapUpdate::centre (rounding.h)
//   normal      3 bytes
//   distances   3 bytes
//   descriptor  as the feature of a keyframe that the client has made: 2 or 3 bytes; else 32
//   observers   1 byte each, of other clients 2
//   pose        20 bytes, to 2e-6 rad; 24 where the scale of some has changed
//
// Encoding what was decoded changes nothing any more.
//
// Pure functions, safe from any thread.
#pragma once

#include <string_view>
#include <vector>

#include "common/model/map_update.h"
#include "common/util/status.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

// Larger samples suffer on lossy links and stock socket buffers.
inline constexpr std::size_t kMapUpdatePartBytes = 60'000;
inline constexpr std::size_t kMaxMapUpdateBytes = 1 << 18;

// Ranges, unit lengths, and lists that ascend by id.
Status check_map_update(const MapUpdate& update);

// kInvalidArgument when check_map_update objects.
Result<Blob> encode_map_update(std::string_view client, const MapUpdate& update);

// What one entry adds to an update, as a rule (for choosing), and what an update that is not split
// takes (for counting).
std::size_t usual_bytes(const LandmarkState& landmark);
std::size_t usual_bytes(const LandmarkMove& landmark);
std::size_t encoded_bytes(std::string_view client, const MapUpdate& update);

struct DecodedMapUpdate {
  std::string client;
  MapUpdate update;
};
Result<DecodedMapUpdate> decode_map_update(Bytes blob);

// Cuts an update into parts of at most about `max_bytes` each, at least one. Revisions count up
// from `first_revision` and chain: the first part starts at update.base_revision, each further one
// at the revision of the part before. Joined in order with append_part() they make the update
// again.
std::vector<MapUpdate> split_map_update(const MapUpdate& update, std::uint64_t first_revision,
                                        std::size_t max_bytes = kMapUpdatePartBytes);
void append_part(MapUpdate& whole, MapUpdate part);

}  // namespace cairn::wire
