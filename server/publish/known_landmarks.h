// The landmarks that one client has, and what it believes of them.
#pragma once

#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "common/model/ids.h"

#include <Eigen/Core>

namespace cairn {

struct KnownLandmark {
  LandmarkId id;  // not valid: a free slot
  // Whether the client knows what it looks like. One that it has made itself it knows before the
  // server tells.
  bool described = false;
  // Where the client has it; nothing when that can't be said.
  std::optional<Eigen::Vector3d> position;
  // It still moves with the client's keyframe that made it.
  bool anchored = false;
  std::uint32_t observations = 0;  // how many there were when it was described
  float max_distance = 0;          // as it was described, in map; 0: not by the server
  std::uint64_t revision = 0;      // of the landmark when last compared
  std::uint64_t last_near = 0;     // the difference in which it was near
};

class KnownLandmarks {
 public:
  using Slot = std::uint32_t;

  // The slot of a landmark, a new one when it has none.
  Slot know(LandmarkId id);
  std::optional<Slot> find(LandmarkId id) const;
  void forget(Slot slot);
  void clear();

  KnownLandmark& operator[](Slot slot) { return slots_[slot]; }
  // Free slots are among them.
  const std::vector<KnownLandmark>& slots() const { return slots_; }
  std::vector<KnownLandmark>& slots() { return slots_; }
  std::size_t size() const { return slot_of_.size(); }

 private:
  std::vector<KnownLandmark> slots_;
  std::vector<Slot> free_;
  std::unordered_map<LandmarkId, Slot> slot_of_;
};

}  // namespace cairn
