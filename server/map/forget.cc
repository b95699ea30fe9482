#include <vector>

#include "server/map/apply.h"

namespace cairn {
namespace {

// Looking through the tables costs a millisecond or two.
constexpr std::uint64_t kForgetEvery = 100;

template <typename Key, typename Value>
void forget_older(CowTable<Key, Value>& table, std::uint64_t now, std::uint64_t kept) {
  std::vector<Key> old;
  table.for_each([&](const Key& key, const Value& former) {
    if (former.since + kept < now) old.push_back(key);
  });
  for (const Key& key : old) table.erase(key);
}

}  // namespace

void forget_former(Map& map) {
  if (map.keyframes_ever % kForgetEvery != 0) return;
  forget_older(map.replaced_landmarks, map.keyframes_ever, kFormerLandmarksKept);
  forget_older(map.removed_keyframes, map.keyframes_ever, kFormerKeyframesKept);
}

}  // namespace cairn
