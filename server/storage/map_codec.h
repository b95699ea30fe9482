// The parts of a map as bytes in the map file, and back. Doubles stay doubles: a map that is loaded
// equals the one that was saved, bit for bit. Private to server/storage.
//
// Stored is what cannot be derived: a keyframe's pose and parent, a landmark with its observations.
// The rest follows (map_connect.h).
#pragma once

#include "common/wire/bytes.h"
#include "server/map/map.h"

namespace cairn::storage {

using wire::Blob;
using wire::ByteReader;
using wire::Bytes;
using wire::ByteWriter;

void put(ByteWriter& out, const Eigen::Vector3d& v);
void put(ByteWriter& out, const Sim3& transform);
void put(ByteWriter& out, KeyframeId id);
void put(ByteWriter& out, LandmarkId id);
void put(ByteWriter& out, const FormerKeyframe& former);
void put(ByteWriter& out, const FormerLandmark& former);
// Pose with unit, parent and revisions; the rest of a node is derived.
void put(ByteWriter& out, const KeyframeNode& node);
void put(ByteWriter& out, const Landmark& landmark);  // without its name
void put(ByteWriter& out, const LoopEdge& edge);

// After a read past the end they give zeros: the reader tells (ByteReader::ok).
Eigen::Vector3d get_vector(ByteReader& in);
Sim3 get_transform(ByteReader& in);
KeyframeId get_keyframe(ByteReader& in);
LandmarkId get_landmark(ByteReader& in);

// These look at what was read too. False: it is not what `put` writes.
bool get(ByteReader& in, FormerKeyframe& former);
bool get(ByteReader& in, FormerLandmark& former);
bool get(ByteReader& in, KeyframeNode& node);
bool get(ByteReader& in, Landmark& landmark);
bool get(ByteReader& in, LoopEdge& edge);

// The numbers that stand before a map's tables.
void put_header(ByteWriter& out, const Map& map);
void get_header(ByteReader& in, Map& map);

template <typename T>
Blob encode(const T& value) {
  ByteWriter out(64);  // many are kept at a time
  put(out, value);
  return out.take();
}
// False when the bytes are not exactly what encode() writes.
template <typename T>
bool decode(Bytes bytes, T& value) {
  ByteReader in(bytes);
  return get(in, value) && in.at_end();
}

}  // namespace cairn::storage
