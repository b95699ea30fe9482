// The parts of a map as bytes in the map file, and the map from its parts. Doubles stay doubles: a
// map that is loaded equals the one that was saved, bit for bit.
//
// Stored is what cannot be derived: a keyframe's pose and parent, a landmark with its observations.
// The other direction (which landmark a feature shows), covisibility and children follow.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/util/status.h"
#include "server/map/map.h"

namespace cairn::storage {

using Blob = std::vector<std::uint8_t>;
using Bytes = std::span<const std::uint8_t>;

Blob encode_node(const KeyframeNode& node);
// Fills in what encode_node wrote. False when the bytes are not those of a node.
bool decode_node(Bytes bytes, KeyframeNode& node);

Blob encode_landmark(const Landmark& landmark);
// `landmark.id` is the caller's to set.
bool decode_landmark(Bytes bytes, Landmark& landmark);

Blob encode_former(const FormerKeyframe& former);
bool decode_former(Bytes bytes, FormerKeyframe& former);
Blob encode_former(const FormerLandmark& former);
bool decode_former(Bytes bytes, FormerLandmark& former);

// Derives what is not stored. kCorrupt when relations lead nowhere or contradict each other.
Status connect(Map& map);

}  // namespace cairn::storage
