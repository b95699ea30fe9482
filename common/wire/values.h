// Parts that several blobs have in common: transforms, descriptors, ids with their table of epochs,
// and the checks of each.
#pragma once

#include <cstdint>
#include <optional>
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
void put_similarity(ByteWriter& out, const Sim3& transform);
Sim3 get_similarity(ByteReader& in);
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
  std::uint32_t place(std::uint64_t epoch) const { return places_.at(epoch); }

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
  // Nothing when the table is shorter.
  std::optional<std::uint64_t> epoch(std::uint64_t place) const {
    return place < epochs_.size() ? std::optional(epochs_[place]) : std::nullopt;
  }

 private:
  std::vector<std::uint64_t> epochs_;
};

// The landmark ids of one list, ascending: each by its distance from the one before, most in a byte
// or two.
class AscendingIdsWriter {
 public:
  explicit AscendingIdsWriter(const EpochTableWriter& epochs) : epochs_(epochs) {}
  void put(ByteWriter& out, LandmarkId id);

 private:
  const EpochTableWriter& epochs_;
  LandmarkId before_;
};

class AscendingIdsReader {
 public:
  explicit AscendingIdsReader(const EpochTableReader& epochs) : epochs_(epochs) {}
  // Not valid when malformed; of any order.
  LandmarkId get(ByteReader& in);

 private:
  const EpochTableReader& epochs_;
  LandmarkId before_;
};

// Numbers of either sign as numbers without, small ones as small ones: for varints.
inline std::uint64_t zigzag(std::int64_t value) {
  return static_cast<std::uint64_t>(value) << 1 ^ static_cast<std::uint64_t>(value >> 63);
}
inline std::int64_t unzigzag(std::uint64_t code) {
  return static_cast<std::int64_t>(code >> 1 ^ -(code & 1));
}

}  // namespace cairn::wire
