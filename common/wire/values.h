// Parts that several blobs have in common: transforms, descriptors, ids with their table of epochs,
// and the checks of each.
#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "common/geometry/rigid3.h"
#include "common/geometry/sim3.h"
#include "common/model/features.h"
#include "common/model/ids.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

// Finite, rotation of unit length to 1e-6, no further than 10 000 km.
bool is_sound(const Rigid3& transform);
bool is_sound(const Sim3& transform);
// A landmark of the server, or one that a client can have made.
bool is_sound(const LandmarkId& id);

void put_rigid(ByteWriter& out, const Rigid3& transform);
Rigid3 get_rigid(ByteReader& in);
void put_descriptor(ByteWriter& out, const Descriptor& descriptor);
Descriptor get_descriptor(ByteReader& in);

inline constexpr std::size_t kRigidBytes = 7 * 8;
inline constexpr std::size_t kDescriptorBytes = 32;

// Most ids of a message share a few epochs; the message lists these once, in the order of their
// first appearance, and each id then names its epoch by the place in that list.
class EpochTableWriter {
 public:
  void add(std::uint64_t epoch);
  void put_table(ByteWriter& out) const;
  void put(ByteWriter& out, KeyframeId id) const;
  void put(ByteWriter& out, LandmarkId id) const;

 private:
  std::unordered_map<std::uint64_t, std::uint32_t> places_;
  std::vector<std::uint64_t> epochs_;
};

// Malformed ids come back as not valid; check with is_valid() or is_sound().
class EpochTableReader {
 public:
  // False, and nothing read, when the table is malformed or lists an epoch twice.
  bool read(ByteReader& in);
  KeyframeId get_keyframe(ByteReader& in) const;
  LandmarkId get_landmark(ByteReader& in) const;

 private:
  std::vector<std::uint64_t> epochs_;
};

}  // namespace cairn::wire
