// A map update as bytes. Poses stay double; landmark positions are rounded to float (0.06 mm at 1
// km) and normals to 16 bits a component. Epochs go through a table, so an id takes 2 to 6 bytes.
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

// Ranges, unit lengths, and no id twice in one list.
Status check_map_update(const MapUpdate& update);

// kInvalidArgument when check_map_update objects.
Result<Blob> encode_map_update(std::string_view client, const MapUpdate& update);

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
