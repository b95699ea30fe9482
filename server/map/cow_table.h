// Table with cheap copies: a copy shares all entries with the original, and whichever of the two is
// changed first makes its own copy of the part that changes. This is what makes a snapshot of a map
// cost microseconds while its owner goes on changing it.
//
// Three levels, each shared between copies until written to: groups of shards, shards, which are
// small sorted arrays, and the values in them. Reading a copy from other threads while the original
// is changed is safe (see cow_ptr.h); one object itself has one writer and no concurrent readers.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "server/map/cow_ptr.h"

namespace cairn {

// Which keys stand together. Specialise it where keys that are changed together can be told: fewer
// shards are copied then.
template <typename Key>
struct CowShardHash {
  std::size_t operator()(const Key& key) const { return std::hash<Key>{}(key); }
};

template <typename Key, typename Value>
class CowTable {
 public:
  // Null when there is none. Valid until this object is changed or destroyed.
  const Value* find(const Key& key) const {
    const Shard* shard = shard_at(place_of(key));
    if (!shard) return nullptr;
    const auto it = position(*shard, key);
    return it != shard->end() && it->first == key ? it->second.get() : nullptr;
  }
  bool contains(const Key& key) const { return find(key) != nullptr; }
  const Value& at(const Key& key) const { return *find(key); }

  // The value to change; null when there is none. Copies what other copies still share.
  Value* edit(const Key& key) {
    const Place place = place_of(key);
    const Shard* shared = shard_at(place);
    if (!shared) return nullptr;
    const auto it = position(*shared, key);
    if (it == shared->end() || it->first != key) return nullptr;
    const auto index = static_cast<std::size_t>(it - shared->begin());
    return &edit_shard(place)[index].second.edit();
  }

  // Replaces a value of the same key.
  Value& insert(const Key& key, Value value) {
    Shard& shard = edit_shard(place_of(key));
    auto it = position(shard, key);
    if (it == shard.end() || it->first != key) {
      it = shard.emplace(it, key, CowPtr<Value>());
      ++size_;
    }
    it->second = CowPtr<Value>::make(std::move(value));
    return it->second.edit();
  }

  bool erase(const Key& key) {
    if (!contains(key)) return false;
    Shard& shard = edit_shard(place_of(key));
    shard.erase(position(shard, key));
    --size_;
    return true;
  }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }

  // In ascending order, so that loops over the table run alike in every run.
  std::vector<Key> sorted_keys() const {
    std::vector<Key> keys;
    keys.reserve(size_);
    for_each([&](const Key& key, const Value&) { keys.push_back(key); });
    std::sort(keys.begin(), keys.end());
    return keys;
  }

  // Calls f(key, value) for each entry; the order is the same for the same keys.
  template <typename F>
  void for_each(F&& f) const {
    for (const CowPtr<Group>& group : groups_) {
      if (!group) continue;
      for (const CowPtr<Shard>& shard : *group)
        if (shard)
          for (const auto& [key, value] : *shard) f(key, *value);
    }
  }

 private:
  // 300 000 landmarks make shards of about 300; copying one costs a microsecond or two.
  static constexpr std::size_t kGroups = 32, kShardsEach = 32;
  using Shard = std::vector<std::pair<Key, CowPtr<Value>>>;  // ascending by key
  using Group = std::array<CowPtr<Shard>, kShardsEach>;
  struct Place {
    std::size_t group, shard;
  };

  static Place place_of(const Key& key) {
    const std::size_t hash = CowShardHash<Key>{}(key) >> 40;
    return {hash / kShardsEach % kGroups, hash % kShardsEach};
  }
  // Null where there is none.
  const Shard* shard_at(const Place& place) const {
    const CowPtr<Group>& group = groups_[place.group];
    return group ? (*group)[place.shard].get() : nullptr;
  }
  // Makes it where there is none.
  Shard& edit_shard(const Place& place) {
    CowPtr<Group>& group = groups_[place.group];
    if (!group) group = CowPtr<Group>::make();
    CowPtr<Shard>& shard = group.edit()[place.shard];
    if (!shard) shard = CowPtr<Shard>::make();
    return shard.edit();
  }
  template <typename S>
  static auto position(S& shard, const Key& key) {
    return std::lower_bound(shard.begin(), shard.end(), key,
                            [](const auto& entry, const Key& k) { return entry.first < k; });
  }

  std::array<CowPtr<Group>, kGroups> groups_;
  std::size_t size_ = 0;
};

}  // namespace cairn
