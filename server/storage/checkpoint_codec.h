// The whole estimate of a map as one blob: what going back to before a loop or a merge needs.
// Keyframes are named only, their measurements stand in the file anyway. About half the size of the
// same map in the tables: numbers are small or differences to the one before, an observation names
// its keyframe by its place in the blob, and a descriptor is the one of an observation.
// Private to server/storage.
#pragma once

#include <functional>

#include "common/util/status.h"
#include "server/storage/map_codec.h"

namespace cairn::storage {

// Takes some tenths of a second for 100 000 landmarks.
Blob encode_checkpoint(const Map& map);

// Gives the measurement of a keyframe that the blob names.
using LoadKeyframe = std::function<Result<KeyframePtr>(KeyframeId)>;

// The map equals the one that was encoded, bit for bit. kCorrupt when its checksum is wrong or it
// contradicts itself or the keyframes; errors of `load` are passed on.
Result<Map> decode_checkpoint(Bytes bytes, const LoadKeyframe& load);

// The last step of encode_checkpoint(), for tests that forge a blob.
void append_checksum(Blob& bytes);

}  // namespace cairn::storage
