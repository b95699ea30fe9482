// A map file as a server leaves it that has mapped a large place and closed a loop in it.
#pragma once

#include <filesystem>

#include "common/model/ids.h"
#include "common/util/status.h"
#include "tests/bench/ring_world.h"

namespace cairn::bench {

// The run that made all keyframes of the file.
inline const ClientId kRingClient{"ring", 7};

// All keyframes journaled and mapped, poses and landmarks disturbed as in the world.
Status write_ring_map(const RingWorldOptions& options, const std::filesystem::path& path);

}  // namespace cairn::bench
