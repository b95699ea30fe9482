#include <vector>

#include "server/map/apply.h"

namespace cairn {
namespace {

// Looking through the tables costs a millisecond or two.
constexpr std::uint64_t kForgetEvery = 100;

template <typename Key, typename Value>
void forget_before(CowTable<Key, Value>& table, std::uint64_t limit) {
  std::vector<Key> old;
  table.for_each([&](const Key& key, const Value& former) {
    if (former.since < limit) old.push_back(key);
  });
  for (const Key& key : old) table.erase(key);
}

}  // namespace

void forget_former(Map& map) {
  if (map.keyframes_ever % kForgetEvery != 0 || map.keyframes_ever < kFormerKept) return;
  const std::uint64_t limit = map.keyframes_ever - kFormerKept;
  forget_before(map.replaced_landmarks, limit);
  forget_before(map.removed_keyframes, limit);
}

}  // namespace cairn
