// Which landmarks have come by: for the lists of several keyframes, which name most of their
// landmarks again and again.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "common/model/ids.h"

namespace cairn {

// Set of valid names with open addressing: neither memory of its own for each name nor an order.
// Not thread-safe.
class LandmarkSet {
 public:
  explicit LandmarkSet(std::size_t expected = 0) { grow_to(2 * expected); }

  // False when it is there already.
  bool insert(LandmarkId id) {
    if (2 * (size_ + 1) > slots_.size()) grow_to(2 * slots_.size());
    LandmarkId& slot = slots_[place_of(id)];
    if (slot == id) return false;
    slot = id;
    ++size_;
    return true;
  }
  std::size_t size() const { return size_; }

 private:
  // Where it is or, if it is not there, would be.
  std::size_t place_of(LandmarkId id) const {
    std::size_t place = std::hash<LandmarkId>{}(id) & (slots_.size() - 1);
    while (slots_[place].is_valid() && slots_[place] != id)
      place = (place + 1) & (slots_.size() - 1);
    return place;
  }
  void grow_to(std::size_t slots) {
    std::size_t size = 64;  // a power of two
    while (size < slots) size *= 2;
    std::vector<LandmarkId> old(size);
    old.swap(slots_);
    for (const LandmarkId id : old)
      if (id.is_valid()) slots_[place_of(id)] = id;
  }

  std::vector<LandmarkId> slots_;
  std::size_t size_ = 0;
};

}  // namespace cairn
