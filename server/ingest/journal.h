// Where ingest puts keyframes before it acknowledges them: from then on the client forgets them, so
// the journal is what stands between a crash and a loss.
#pragma once

#include <cstdint>
#include <span>

#include "common/model/ids.h"
#include "common/util/status.h"

namespace cairn {

// Called from ingest's own thread only.
class Journal {
 public:
  virtual ~Journal() = default;

  // Keeps the blob (common/wire/keyframe_codec.h). When it returns ok, the keyframe survives a
  // crash of the process. Sequences of one client run ascend; a gap means that the missing ones
  // were acknowledged by a server whose journal is gone. On failure the keyframe is not
  // acknowledged and comes again.
  virtual Status append(const ClientId& client, KeyframeId id,
                        std::span<const std::uint8_t> blob) = 0;

  // One past the highest sequence ever appended for that run; 0 when there is none. Must count
  // keyframes that have since been moved from the journal into the map file.
  virtual std::uint32_t next_sequence(const ClientId& client) = 0;
};

}  // namespace cairn
