// Which keyframes look alike: all keyframes of all maps, found by the words that they share.
//
// An inverted index: a query visits only keyframes that have a word in common with it. At 5000
// keyframes of 1000 features it takes about a millisecond (tests/bench/RESULTS.md); memory is about
// 20 kB a keyframe.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <shared_mutex>
#include <unordered_map>
#include <vector>

#include "common/model/ids.h"
#include "server/place/bag_of_words.h"

namespace cairn {

struct PlaceMatch {
  KeyframeId keyframe;
  double score = 0;  // similarity() of the bags

  bool operator==(const PlaceMatch&) const = default;
};

// May be used from several threads: readers don't wait for each other, a writer waits for them.
class PlaceIndex {
 public:
  // Replaces what is there of that keyframe.
  void add(KeyframeId keyframe, Words words);
  // False when it was not there.
  bool remove(KeyframeId keyframe);

  // Keyframes whose score is above 0 and at least `least_score`, best first, of equals the lesser
  // id; those that `accept` turns down are left out (null: all are welcome). `accept` is called
  // while the index is locked and must not call it.
  using Filter = std::function<bool(KeyframeId)>;
  std::vector<PlaceMatch> query(const BagOfWords& bag, double least_score = 0,
                                const Filter& accept = {}) const;

  // Null when there is none. Stays valid after the keyframe is removed.
  std::shared_ptr<const Words> words_of(KeyframeId keyframe) const;
  std::size_t size() const;

 private:
  // Keyframes have numbers as long as they are here, so that a query can count in an array.
  struct Posting {
    std::uint32_t slot;
    float weight;
  };
  struct Slot {
    KeyframeId keyframe;
    std::shared_ptr<const Words> words;  // null: free
  };
  void drop(std::uint32_t slot);

  mutable std::shared_mutex mutex_;
  std::vector<std::vector<Posting>> postings_;  // by word
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_slots_;
  std::unordered_map<KeyframeId, std::uint32_t> slot_of_;
};

}  // namespace cairn
