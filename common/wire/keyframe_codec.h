// A keyframe as bytes: what travels to the server, waits in the client's outbox, and is kept in the
// server's journal and map file. About 31 bytes a feature (features_codec.h), and 5 for each that
// shows a landmark made before.
//
// Measurements are rounded to what they are worth; noise, stamp, camera and poses are kept as they
// are.
// Encoding what was decoded gives the same bytes again.
//
// Pure functions, safe from any thread.
#pragma once

#include <string>
#include <string_view>

#include "common/model/keyframe.h"
#include "common/util/status.h"
#include "common/wire/bytes.h"
#include "common/wire/features_codec.h"

namespace cairn::wire {

inline constexpr std::size_t kMaxKeyframeBytes = 1 << 20;
inline constexpr std::size_t kMaxClientName = 64;

// 1 to 64 of A-Z a-z 0-9 _ - . ; not starting with a dot, because files are named after clients.
Status check_client_name(std::string_view name);

// Whether every value lies in its range and every relation inside the keyframe holds: camera and
// pyramid plausible, transforms finite and rotations of unit length, octaves below the number of
// levels, matches ascending and of existing features, no landmark twice. Both directions check it.
Status check_keyframe(const Keyframe& keyframe);

// Features that lie outside the range of positions keep their place in the order but lose their
// depth and match; of several matches of one landmark the first is kept. kInvalidArgument when the
// keyframe is not sound even so (check_keyframe).
Result<Blob> encode_keyframe(std::string_view client, const Keyframe& keyframe);

struct DecodedKeyframe {
  ClientId client;
  KeyframePtr keyframe;  // with a rig of its own
};
// kCorrupt or kVersion for everything that encode_keyframe would not have written.
Result<DecodedKeyframe> decode_keyframe(Bytes blob);

}  // namespace cairn::wire
