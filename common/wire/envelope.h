// The frame around every blob: what it is, in which version, how long, and a checksum. 16 bytes:
//   0  4  kind, as letters
//   4  2  version of the payload's format
//   6  2  zero
//   8  4  length of the payload
//  12  4  CRC-32 (IEEE 802.3, reflected 0xEDB88320) of bytes 0..11 and the payload
#pragma once

#include <cstdint>

#include "common/util/status.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

struct Format {
  char kind[5];           // four letters
  std::uint16_t version;  // of the payload
  const char* name;       // for messages
};

inline constexpr std::size_t kEnvelopeSize = 16;
inline constexpr Format kKeyframeFormat{"CRNK", 4, "keyframe"};
inline constexpr Format kMapUpdateFormat{"CRNU", 3, "map update"};

Blob seal(const Format& format, Bytes payload);

// The payload inside `blob`. kCorrupt for anything that is no undamaged blob of that kind, kVersion
// for one of another version.
Result<Bytes> unseal(const Format& format, Bytes blob);

}  // namespace cairn::wire
